"""The same guarantees under every launcher: exceptions, crashes, limits, kills and Ctrl-C amid a sweep."""

from __future__ import annotations

import importlib.util
import os
import random
import re
import signal
import sqlite3
import time
from collections import Counter
from contextlib import closing, suppress
from pathlib import Path

import pytest

from tests.shell import ODD, Shell, open_gate, processes, records, started, tracked, until

RAY = pytest.mark.skipif(
    not importlib.util.find_spec("hydra_plugins.hydra_ray_launcher"), reason="the ray extra is absent"
)
LAUNCHERS = [
    "basic",
    pytest.param("joblib", marks=pytest.mark.slow),
    pytest.param("submitit_local", marks=pytest.mark.slow),
    pytest.param("ray", marks=[pytest.mark.slow, RAY]),
]
pytestmark = pytest.mark.timeout(1800)
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
#: Four trials: two end at once, the others when the gate is opened.
GATE = ("run", "-m", *ODD, "+method.how=ok,gate", "noise.level=0.01", "noise.repeat=0,1", "workers=2")


@every_launcher
def test_a_killed_sweep_of_misbehaving_trials_is_finished_later(
    shell: Shell, environment: dict[str, str], tmp_path: Path, launcher: str
) -> None:
    """kill -9 of the sweep's own process: its workers end with it, and the next start runs exactly the rest.

    Every way to misbehave becomes a record and a run in the tracker, and harms no other trial.
    """
    ways, limits = ",".join(WAYS), ("limits.seconds=10", "limits.memory_gb=2")
    words = ("run", "-m", *ODD, f"+method.how={ways}", f"hydra/launcher={launcher}", "workers=2", *limits)
    sweep = started(environment, tmp_path, *words)
    until(lambda: records(tmp_path), sweep)
    sweep.kill()
    sweep.communicate()
    until(lambda: not processes(tmp_path))
    before = {key: r["finished"] for key, r in records(tmp_path).items()}
    assert 0 < len(before) < 9
    again = shell(*words)
    assert again.returncode == 2, again.stderr
    counts = f"{9 - len(before)} run, {len(before)} done before, 3 crashed, 3 failed, 1 oom, 1 timeout"
    assert f"9 trials: {counts}" in again.stdout
    after = records(tmp_path)
    assert {key: after[key]["finished"] for key in before} == before
    by_way = {r["parameters"]["method"]["how"]: r for r in after.values()}
    assert {how: r["status"] for how, r in by_way.items()} == {how: status for how, (status, _) in WAYS.items()}
    for how, (_, word) in WAYS.items():
        assert word in by_way[how]["error"]
    runs = sorted((t.outcome.key, t.outcome.status) for t in tracked(tmp_path))
    assert runs == sorted((key, r["status"]) for key, r in after.items())


@pytest.mark.parametrize(
    ("launcher", "sign"),
    [
        ("basic", signal.SIGINT),
        pytest.param("basic", signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param("joblib", signal.SIGINT, marks=pytest.mark.slow),
        pytest.param("joblib", signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param("submitit_local", signal.SIGINT, marks=pytest.mark.slow),
        pytest.param("submitit_local", signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param("ray", signal.SIGINT, marks=[pytest.mark.slow, RAY]),
        pytest.param("ray", signal.SIGTERM, marks=[pytest.mark.slow, RAY]),
    ],
)
def test_interrupted_sweep_says_so_and_goes_on_later(
    shell: Shell, environment: dict[str, str], tmp_path: Path, launcher: str, sign: signal.Signals
) -> None:
    """Ctrl-C reaches the whole process group, a scheduler's SIGTERM only the sweep's own process."""
    words = (*GATE, f"hydra/launcher={launcher}")
    sweep = started(environment, tmp_path, *words)
    until(lambda: len(records(tmp_path)) == 2, sweep)
    os.killpg(sweep.pid, sign) if sign is signal.SIGINT else sweep.send_signal(sign)
    _, err = sweep.communicate(timeout=600)
    assert sweep.returncode == 130
    assert "nrsfm run: interrupted; what was finished is kept" in err
    assert "Traceback" not in err
    until(lambda: not processes(tmp_path))
    before = records(tmp_path)
    assert sorted(t.outcome.key for t in tracked(tmp_path)) == sorted(before)
    assert len(before) == 2
    open_gate(tmp_path)
    again = shell(*words)
    assert again.returncode == 0, again.stderr
    assert "2 run, 2 done before" in again.stdout
    assert sorted(t.outcome.key for t in tracked(tmp_path)) == sorted(records(tmp_path))


@pytest.mark.parametrize("n_processes", [2, 3, 4])
def test_interrupt_while_everything_loads(environment: dict[str, str], tmp_path: Path, n_processes: int) -> None:
    """Ctrl-C also reaches processes that were started a moment ago, and they print nothing."""
    sweep = started(environment, tmp_path, *GATE)
    until(lambda: len(processes(tmp_path)) >= n_processes, sweep)
    os.killpg(sweep.pid, signal.SIGINT)
    _, err = sweep.communicate(timeout=600)
    assert sweep.returncode == 130
    assert err.splitlines()[-1] == "nrsfm run: interrupted; what was finished is kept"
    assert "Traceback" not in err


@pytest.mark.parametrize(
    "launcher",
    [
        pytest.param("basic", marks=pytest.mark.slow),
        "joblib",
        "submitit_local",
        pytest.param("ray", marks=[pytest.mark.slow, RAY]),
    ],
)
def test_killed_workers_cost_nothing(environment: dict[str, str], tmp_path: Path, launcher: str) -> None:
    """Everything but the sweep's own process is killed once: workers, trials, their server, the tracker's writer."""
    sweep = started(environment, tmp_path, *GATE, f"hydra/launcher={launcher}", "hydra.verbose=false")
    until(lambda: len(records(tmp_path)) == 2, sweep)
    for pid in processes(tmp_path):
        if pid != sweep.pid and launcher not in _title(pid):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
    open_gate(tmp_path)
    out, err = sweep.communicate(timeout=600)
    assert (sweep.returncode, "4 trials: 4 run. " in out) == (0, True), (out, err)
    assert {r["status"] for r in records(tmp_path).values()} == {"ok"}
    assert sorted(t.outcome.key for t in tracked(tmp_path)) == sorted(records(tmp_path))


def _title(pid: int) -> str:
    """Command line of a process, but "" for Ray's workers: Ray's own processes carry its name, and it needs them."""
    try:
        title = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
    except OSError:
        return ""
    return "" if "ray::" in title and "Agent" not in title else title


KINDS = ("sweep", "writer", "server", "trial", "worker")
#: What joblib's resource tracker prints, started again after a kill, of what the first had registered (joblib #1243).
FORGOTTEN = re.compile(r'Traceback \(.*\n  File ".*/loky/backend/resource_tracker\.py", .*\n(?: .*\n)+KeyError: .*\n')


def _kinds(tmp_path: Path, sweep: int) -> dict[str, list[int]]:
    """The processes of a sweep by kind; ``worker`` is a launcher's, or a helper of multiprocessing or a launcher."""
    kinds: dict[str, list[int]] = {kind: [] for kind in KINDS}
    parents, lines = {}, {}
    for pid in processes(tmp_path):
        try:
            parents[pid] = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
            lines[pid] = Path(f"/proc/{pid}/cmdline").read_text()
        except OSError:
            continue
        if pid == sweep:
            kind = "sweep"
        elif "multiprocessing.spawn" in lines[pid]:
            kind = "writer"
        elif "forkserver" not in lines[pid]:
            kind = "worker"
        else:
            kind = "trial" if "forkserver" in lines.get(parents[pid], "") else "server"
        kinds[kind].append(pid)
    return kinds


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
        repeats = f"noise.repeat=range({total})"
        words = ["run", "-m", *ODD, "+method.how=ok", "noise.level=0.01", repeats, "workers=2"]
        words.append(f"hydra/launcher={launcher}")
        begun = time.monotonic()
        sweep = started(environment, tmp_path, *words)
        time.sleep(rng.uniform(0.2, length))
        kind = rng.choice(KINDS)
        end = time.monotonic() + 1.0  # a trial lives for a moment
        while sweep.poll() is None and not (victims := _kinds(tmp_path, sweep.pid)[kind]) and time.monotonic() < end:
            time.sleep(0.005)
        if sweep.poll() is None and victims:
            with suppress(ProcessLookupError):
                os.kill(rng.choice(victims), signal.SIGKILL)
                killed[kind] += 1
        out, err = sweep.communicate(timeout=600)
        assert "Traceback" not in FORGOTTEN.sub("", err), err
        if sweep.returncode == 0:
            length = time.monotonic() - begun
            assert len(records(tmp_path)) == total, out
        until(lambda: not processes(tmp_path))
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
