"""The same guarantees under every launcher: an exception, a crash, a limit, a kill, Ctrl-C, amid a sweep."""

from __future__ import annotations

import importlib.util
import os
import random
import signal
import sqlite3
import time
from collections import Counter
from contextlib import closing
from pathlib import Path

import pytest

from tests.shell import ODD, Shell, processes, records, started, tracked, until

RAY = pytest.mark.skipif(
    not importlib.util.find_spec("hydra_plugins.hydra_ray_launcher"), reason="the ray extra is absent"
)
LAUNCHERS = ["basic", "joblib", "submitit_local", pytest.param("ray", marks=[pytest.mark.slow, RAY])]
every_launcher = pytest.mark.parametrize("launcher", LAUNCHERS)

WAYS = {
    "ok": ("ok", ""),
    "raise": ("failed", "RuntimeError: the method raised <b>this</b>"),
    "hang": ("timeout", "more than 10 s"),
    "kill": ("crashed", "SIGKILL"),
    "segfault": ("crashed", "SIGSEGV"),
    "exit": ("crashed", "exit code 3"),
    "memory": ("oom", "more than 2 GB"),
    "diverge": ("failed", "it diverged"),
    "nothing": ("failed", "promises labels"),
}
SLOW = ("run", "-m", *ODD, "+method.how=slow", "noise.level=0.01", "noise.repeat=range(6)", "workers=2")


@every_launcher
def test_misbehaving_trials_become_rows_and_the_rest_completes(shell: Shell, tmp_path: Path, launcher: str) -> None:
    words = ("run", "-m", *ODD, f"+method.how={','.join(WAYS)}", f"hydra/launcher={launcher}", "workers=2")
    done = shell(*words, "limits.seconds=10", "limits.memory_gb=2")
    assert done.returncode == 2, done.stderr
    assert "9 trials: 9 run, 3 crashed, 3 failed, 1 oom, 1 timeout" in done.stdout
    found = {r["parameters"]["method"]["how"]: r for r in records(tmp_path).values()}
    assert {how: r["status"] for how, r in found.items()} == {how: status for how, (status, _) in WAYS.items()}
    for how, (_, word) in WAYS.items():
        assert word in found[how]["error"]
    rows = {key: r["status"] for key, r in records(tmp_path).items()}
    assert {t.outcome.key: t.outcome.status for t in tracked(tmp_path)} == rows
    assert len(tracked(tmp_path)) == 9
    again = shell(*words)
    assert again.returncode == 2
    assert "nothing to run, 9 done before" in again.stdout
    assert "rerun=failed" in again.stdout


@every_launcher
def test_killed_sweep_loses_no_finished_trial(
    shell: Shell, environment: dict[str, str], tmp_path: Path, launcher: str
) -> None:
    """kill -9 of the sweep's process alone: its workers end with it, the next start runs exactly the rest."""
    words = (*SLOW, f"hydra/launcher={launcher}")
    sweep = started(environment, tmp_path, *words)
    until(lambda: records(tmp_path))
    sweep.kill()
    sweep.communicate()
    until(lambda: not processes(tmp_path), 30)
    before = {key: r["finished"] for key, r in records(tmp_path).items()}
    assert len(before) < 6
    again = shell(*words)
    assert again.returncode == 0, again.stderr
    assert f"{6 - len(before)} run, {len(before)} done before" in again.stdout
    after = records(tmp_path)
    assert {key: after[key]["finished"] for key in before} == before
    assert sorted(t.outcome.key for t in tracked(tmp_path)) == sorted(after)
    assert len(after) == 6


@pytest.mark.parametrize(
    ("launcher", "sign"),
    [
        ("basic", signal.SIGINT),
        ("basic", signal.SIGTERM),
        ("joblib", signal.SIGINT),
        pytest.param("joblib", signal.SIGTERM, marks=pytest.mark.slow),
        ("submitit_local", signal.SIGTERM),
        pytest.param("submitit_local", signal.SIGINT, marks=pytest.mark.slow),
        pytest.param("ray", signal.SIGINT, marks=[pytest.mark.slow, RAY]),
        pytest.param("ray", signal.SIGTERM, marks=[pytest.mark.slow, RAY]),
    ],
)
def test_interrupted_sweep_says_so_and_goes_on_later(
    shell: Shell, environment: dict[str, str], tmp_path: Path, launcher: str, sign: signal.Signals
) -> None:
    """Ctrl-C reaches the whole process group, a scheduler's SIGTERM the sweep alone."""
    words = (*SLOW, f"hydra/launcher={launcher}")
    sweep = started(environment, tmp_path, *words)
    until(lambda: records(tmp_path))
    os.killpg(sweep.pid, sign) if sign is signal.SIGINT else sweep.send_signal(sign)
    _, err = sweep.communicate(timeout=60)
    assert sweep.returncode == 130
    assert "nrsfm run: interrupted; what was finished is kept" in err
    assert "Traceback" not in err
    until(lambda: not processes(tmp_path), 30)
    before = len(records(tmp_path))
    assert before == len(tracked(tmp_path))
    again = shell(*words)
    assert again.returncode == 0, again.stderr
    assert f"{6 - before} run, {before} done before" in again.stdout


@pytest.mark.parametrize("seconds", [1.0, 2.0, 2.5])
def test_interrupt_while_everything_loads(environment: dict[str, str], tmp_path: Path, seconds: float) -> None:
    """Ctrl-C reaches what was started a moment ago, too, and that says nothing of it."""
    sweep = started(environment, tmp_path, *SLOW)
    time.sleep(seconds)
    os.killpg(sweep.pid, signal.SIGINT)
    _, err = sweep.communicate(timeout=60)
    assert sweep.returncode == 130
    assert err.splitlines()[-1] == "nrsfm run: interrupted; what was finished is kept"
    assert "Traceback" not in err


@pytest.mark.parametrize(
    "launcher",
    [
        "basic",
        "joblib",
        *(
            pytest.param(name, marks=[pytest.mark.slow, RAY] if name == "ray" else pytest.mark.slow)
            for name in ("submitit_local", "ray")
        ),
    ],
)
def test_killed_workers_cost_nothing(environment: dict[str, str], tmp_path: Path, launcher: str) -> None:
    """Everything but the sweep's own process is killed once: workers, trials, and the server that forks them."""
    sweep = started(environment, tmp_path, *SLOW, f"hydra/launcher={launcher}", "hydra.verbose=false")
    until(lambda: records(tmp_path))
    own = [pid for pid in processes(tmp_path) if pid != sweep.pid and launcher not in _title(pid)]
    for pid in own:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            continue
    out, err = sweep.communicate(timeout=120)
    assert (sweep.returncode, "6 trials: 6 run. " in out) == (0, True), (out, err)
    assert {r["status"] for r in records(tmp_path).values()} == {"ok"}
    assert len(tracked(tmp_path)) == 6


def _title(pid: int) -> str:
    """What a process calls itself: Ray's own are known by it, and without them there is no Ray."""
    try:
        title = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
    except OSError:
        return ""
    return "" if "ray::" in title and "Agent" not in title else title


KINDS = ("sweep", "writer", "server", "trial", "worker")


def _kinds(tmp_path: Path, sweep: int) -> dict[str, list[int]]:
    """The processes of a sweep by what they are: trials lead a session of their own, the tracker's writer does not."""
    found: dict[str, list[int]] = {kind: [] for kind in KINDS}
    parents, lines = {}, {}
    for pid in processes(tmp_path):
        try:
            parents[pid] = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
            lines[pid] = Path(f"/proc/{pid}/cmdline").read_text()
            leads = os.getsid(pid) == pid
        except OSError:
            continue
        if pid == sweep:
            kind = "sweep"
        elif "forkserver" not in lines[pid]:
            kind = "worker"  # of a launcher, or what it keeps beside it
        elif "forkserver" not in lines.get(parents[pid], ""):
            kind = "server"
        else:
            kind = "trial" if leads else "writer"
        found[kind].append(pid)
    return found


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("launcher", ["basic", "joblib", "submitit_local"])
def test_fifty_kills_at_random_moments(
    shell: Shell, environment: dict[str, str], tmp_path: Path, launcher: str
) -> None:
    """kill -9 of any process of the sweep at any moment, from the first import to the last line in the store."""
    rng = random.Random(launcher)
    total, length = 0, 6.0
    killed: Counter[str] = Counter()
    while killed.total() < 50:
        total += 10
        words = ("run", "-m", *ODD, "+method.how=ok", "noise.level=0.01", f"noise.repeat=range({total})", "workers=2")
        words = (*words, f"hydra/launcher={launcher}")
        begun = time.monotonic()
        sweep = started(environment, tmp_path, *words)
        time.sleep(rng.uniform(0.2, length))
        kind = rng.choice(KINDS)
        end = time.monotonic() + 1.0  # a trial lives for a moment
        while sweep.poll() is None and not (victims := _kinds(tmp_path, sweep.pid)[kind]) and time.monotonic() < end:
            time.sleep(0.005)
        if sweep.poll() is None and victims:
            try:
                os.kill(rng.choice(victims), signal.SIGKILL)
                killed[kind] += 1
            except ProcessLookupError:
                pass
        out, err = sweep.communicate(timeout=120)
        assert "Traceback" not in err, err
        if sweep.returncode == 0:
            length = time.monotonic() - begun
            assert len(records(tmp_path)) == total, out
        until(lambda: not processes(tmp_path), 30)
        if (tmp_path / "out/mlflow.db").exists():
            with closing(sqlite3.connect(tmp_path / "out/mlflow.db")) as db:
                assert db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        before = {key: r["finished"] for key, r in records(tmp_path).items()}
        again = shell(*words)
        assert again.returncode == 0, again.stderr
        ran = f"{total - len(before)} run" if len(before) < total else "nothing to run"
        assert f"{total} trials: {ran}" in again.stdout, again.stdout
        after = records(tmp_path)
        assert {key: after[key]["finished"] for key in before} == before
        assert {r["status"] for r in after.values()} == {"ok"}
        assert sorted(t.outcome.key for t in tracked(tmp_path)) == sorted(after)
        assert len(after) == total
    print(f"killed: {dict(killed)}")
    assert killed.keys() >= {"sweep", "writer", "server", "trial"}
