"""Sweeps from the command line: failures, limits, resumption, and one run a trial in a real MLflow store."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import sqlite3
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from nrsfm.harness.tracking.tracker import Tracker
from tests.shell import ODD, TINY, Shell, open_gate, processes, records, started, tracked, until

pytestmark = pytest.mark.timeout(1800)


def test_second_time_runs_nothing_and_says_so(nrsfm: Shell, tmp_path: Path) -> None:
    words = ("run", "-m", *TINY, "noise.level=0,0.02", "dataset.seed=0,1")
    first = nrsfm(*words)
    assert (first.returncode, "4 trials: 4 run" in first.stdout) == (0, True), first.stderr
    stamps = {key: r["finished"] for key, r in records(tmp_path).items()}
    second = nrsfm(*words)
    assert (second.returncode, "nothing to run, 4 done before" in second.stdout) == (0, True)
    assert {key: r["finished"] for key, r in records(tmp_path).items()} == stamps
    assert len(tracked(tmp_path)) == 4


@pytest.mark.parametrize(
    "words",
    [pytest.param(["noise.level=0"], marks=pytest.mark.slow), ["noise.level=0", "method=edsc"], ["method=edsc,ssc2d"]],
)
def test_an_experiment_can_be_narrowed(nrsfm: Shell, tmp_path: Path, words: list[str]) -> None:
    """Whatever the experiment sweeps itself, dotted keys too."""
    narrow = [*words, "dataset.points=8", "dataset.frames=12"]
    planned = nrsfm("plan", "experiment=quick", *narrow).stdout
    done = nrsfm("run", "experiment=quick", *narrow)
    assert done.returncode == 0, done.stderr
    n = len(records(tmp_path))
    assert f"{n} trial{'' if n == 1 else 's'}: {n} missing." in planned
    assert n == {1: 5, 2: 1}[len(words)] if "noise.level=0" in words else n == 4


def test_a_sweep_ends_with_the_table_that_it_filled(nrsfm: Shell) -> None:
    small = ("dataset.points=8", "dataset.frames=12", "noise.level=0")
    done = nrsfm("run", "experiment=quick", *small, "method=edsc,ssc2d")
    assert "Experiment quick" in done.stdout
    assert "quick: no published numbers, 2 of 4 cells measured." in done.stdout
    again = nrsfm("run", "-m", *small, "method=edsc,ssc2d")  # nothing to run, and the same numbers
    rows = [[line.split() for line in text.splitlines() if " SSC(2D) " in line] for text in (done.stdout, again.stdout)]
    assert rows[0] == rows[1] != []
    assert "This sweep" in again.stdout
    one = nrsfm("run", *small, "method=edsc")
    assert "Dataset" not in one.stdout  # one trial is no sweep


def test_store_holds_parameters_metrics_curves_and_tags(nrsfm: Shell, tmp_path: Path) -> None:
    assert nrsfm("run", "method=ours", "dataset.points=8", "dataset.frames=12").returncode == 0
    (one,) = tracked(tmp_path)
    tracker = Tracker(one.uri, tmp_path / "out")
    client = tracker.client
    run = client.get_run(one.run_id)
    assert run.data.params["method.l1"] == "0.003"
    assert run.data.params["dataset.points"] == "8"
    assert run.data.metrics["e_3d"] == one.outcome.metrics["e_3d"]
    for name in ("objective", "residual_shape", "residual_expression", "residual_code", "residual_affine"):
        curve = client.get_metric_history(one.run_id, name)
        assert len(curve) > 50, name
        assert [m.step for m in curve] == sorted(m.step for m in curve)
    assert run.data.tags["trial_key"] == one.outcome.key
    assert {"sweep", "dataset", "method", "level", "repeat"} <= run.data.tags.keys()
    assert run.info.status == "FINISHED"
    assert run.info.run_name == "person_face ours"
    (scene,) = run.inputs.dataset_inputs
    assert (scene.dataset.name, json.loads(scene.dataset.profile)["num_tracks"]) == (
        "person_face",
        one.outcome.n_points,
    )
    assert run.data.tags["mlflow.source.name"] == "nrsfm run" and run.data.tags["mlflow.source.git.commit"]
    assert not [name for name in run.data.tags if name.startswith("record")]
    assert tracker.artifact(one.run_id, "result.json") and tracker.artifact(one.run_id, "arrays.npz")
    mode = sqlite3.connect(tmp_path / "out/mlflow.db").execute("PRAGMA journal_mode").fetchone()[0]
    assert mode == "wal"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Callable[[str], None]]:
    """A function that mounts a file system, with options, as the output folder; needs the right to mount."""
    place, mounted = tmp_path / "out", []
    place.mkdir()

    def mount(options: str) -> None:
        command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            pytest.skip(f"no file system can be mounted here: {done.stderr.strip()}")
        mounted.append(place)

    yield mount
    if mounted:
        subprocess.run(["umount", "--lazy", str(place)], check=True)


def test_full_disk_ends_in_one_line_and_the_rest_runs_later(
    nrsfm: Shell, tmp_path: Path, small_disk: Callable[[str], None]
) -> None:
    small_disk("size=16m")
    assert nrsfm("run", *TINY).returncode == 0  # makes the store
    ballast = tmp_path / "out/ballast"
    ballast.write_bytes(b"x" * (shutil.disk_usage(tmp_path / "out").free - (384 << 10)))
    words = ("run", "-m", *TINY, "noise.level=0.01", "noise.repeat=range(40)")
    full = nrsfm(*words)
    assert full.returncode == 2
    lines = [line for line in full.stderr.splitlines() if line.startswith("nrsfm run:")]
    assert len(lines) == 1, full.stderr
    assert f"{tmp_path}/out" in lines[0]
    assert "No space left on device; make room; start it again" in lines[0]
    before = {key: r["finished"] for key, r in records(tmp_path).items()}
    assert 1 < len(before) < 41
    assert {r["status"] for r in records(tmp_path).values()} == {"ok"}
    ballast.unlink()
    again = nrsfm(*words)
    assert (again.returncode, f"{41 - len(before)} run, {len(before) - 1} done before" in again.stdout) == (0, True)
    assert sorted(t.outcome.key for t in tracked(tmp_path)) == sorted(records(tmp_path))


def test_read_only_output_is_refused_in_one_line(
    shell: Shell, tmp_path: Path, small_disk: Callable[[str], None]
) -> None:
    small_disk("ro")
    done = shell("run", *TINY)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [f"nrsfm run: {tmp_path}/out/sweeps: Read-only file system"]


def test_sweep_stops_at_its_limit_and_goes_on_later(shell: Shell, tmp_path: Path) -> None:
    """Running trials are killed and leave no record and no process, and no other begins."""
    words = ("run", "-m", *ODD, "+method.how=gate", "noise.level=0.01", "noise.repeat=range(5)", "workers=2")
    short = shell(*words, "limits.sweep_seconds=3")
    assert short.returncode == 2
    assert "its 3 s are over; start it again to run the rest" in short.stderr
    assert "5 trials: nothing to run, 5 not reached" in short.stdout
    assert records(tmp_path) == {}
    until(lambda: not processes(tmp_path))
    open_gate(tmp_path)
    again = shell(*words)
    assert (again.returncode, "5 trials: 5 run." in again.stdout) == (0, True), again.stderr


def test_killed_trials_are_tried_again(shell: Shell, tmp_path: Path) -> None:
    """As often as ``retries`` says, by several workers, with one line of output each."""
    words = ("run", "-m", *ODD, "+method.how=tire,revive,raise,ok", "noise.level=0.01", "workers=2", "retries=2")
    done = shell(*words)
    assert "4 trials: 4 run, 1 crashed, 1 failed" in done.stdout, done.stdout
    statuses = {r["parameters"]["method"]["how"]: r["status"] for r in records(tmp_path).values()}
    assert statuses == {"tire": "crashed", "revive": "ok", "raise": "failed", "ok": "ok"}
    tries = {how: (tmp_path / "out" / how).stat().st_size for how in ("tire", "revive")}
    assert tries == {"tire": 3, "revive": 3}  # the first, and two more
    assert sum(line.startswith("[") for line in done.stderr.splitlines()) == 4
    again = shell(*words, "rerun=failed", "retries=0")
    assert "2 run, 2 done before, 1 crashed, 1 failed" in again.stdout
    assert (tmp_path / "out/tire").stat().st_size == 4


@pytest.mark.slow
def test_stale_records_are_renewed_when_asked(nrsfm: Shell, tmp_path: Path) -> None:
    words = ("run", "-m", *TINY, "noise.level=0,0.02")
    assert nrsfm(*words).returncode == 0
    path = sorted((tmp_path / "out/trials").glob("*/result.json"))[0]
    record = json.loads(path.read_text())
    record["environment"]["numpy"] = "1.0"
    path.write_text(json.dumps(record))
    told = nrsfm(*words).stdout
    assert "nothing to run, 2 done before" in told and "changed since 1 of them ran; rerun=stale" in told
    assert "! the code or a library changed since 1 ran; rerun=stale" in nrsfm("plan", *words[1:]).stdout
    assert "1 run, 1 done before" in nrsfm(*words, "rerun=stale").stdout
    assert "rerun=stale" not in nrsfm(*words).stdout
    assert "nothing to run, 2 done before" in nrsfm(*words, "rerun=stale").stdout


@pytest.mark.slow
def test_records_of_a_clock_ahead_are_renewed_like_any_other(nrsfm: Shell, tmp_path: Path) -> None:
    """A record is new if it is not the one that the sweep found; clocks differ between machines."""
    words = ("run", "-m", *TINY, "noise.level=0,0.02")
    assert nrsfm(*words).returncode == 0
    path = sorted((tmp_path / "out/trials").glob("*/result.json"))[0]
    path.write_text(json.dumps(json.loads(path.read_text()) | {"finished": "2999-01-01T00:00:00.000+00:00"}))
    assert "2 trials: 2 run." in nrsfm(*words, "rerun=all").stdout
    assert all(r["finished"] < "2999" for r in records(tmp_path).values())
    assert sorted(t.outcome.finished for t in tracked(tmp_path)) == sorted(
        r["finished"] for r in records(tmp_path).values()
    )


@pytest.mark.parametrize("turn", [0, *(pytest.param(i, marks=pytest.mark.slow) for i in range(1, 20))])
def test_two_sweeps_at_once_on_a_fresh_store(environment: dict[str, str], tmp_path: Path, turn: int) -> None:
    words = ("run", "-m", *ODD, "+method.how=slow", "noise.level=0.01", "noise.repeat=0,1,2")
    both = [started(environment, tmp_path, *words) for _ in range(2)]
    ended = [p.communicate(timeout=1200) for p in both]
    assert [p.returncode for p in both] == [0, 0], ended
    ran = sum(int(out.split(" run")[0].split(": ")[-1]) for out, _ in ended if "nothing" not in out)
    assert ran == 3, ended
    keys = [t.outcome.key for t in tracked(tmp_path)]
    assert sorted(keys) == sorted(records(tmp_path))


def test_run_cut_short_in_the_store_is_written_anew(nrsfm: Shell, tmp_path: Path) -> None:
    """A kill between the store's calls leaves a run without its last tag: it counts as nothing and is replaced."""
    assert nrsfm("run", *TINY).returncode == 0
    (one,) = tracked(tmp_path)
    client = Tracker(one.uri, tmp_path / "out").client
    client.delete_tag(one.run_id, "finished")
    assert tracked(tmp_path) == []
    assert "1 run written" in nrsfm("sync").stdout
    (again,) = tracked(tmp_path)
    assert again.run_id != one.run_id
    assert again.outcome == one.outcome


def test_store_whose_making_was_cut_short_is_made_anew(nrsfm: Shell, tmp_path: Path) -> None:
    """A kill in MLflow's migrations leaves a file beside the store's place, never a half-made store in it."""
    (tmp_path / "out").mkdir()
    with sqlite3.connect(tmp_path / "out/.mlflow.db.new") as db:
        db.execute("CREATE TABLE spans (trace_id TEXT)")
    assert nrsfm("run", *TINY).returncode == 0
    assert len(tracked(tmp_path)) == 1


@pytest.mark.slow
def test_killed_rerun_keeps_the_record(shell: Shell, environment: dict[str, str], tmp_path: Path) -> None:
    words = ["run", *ODD, "+method.how=gate"]
    (tmp_path / "out").mkdir()
    open_gate(tmp_path)
    assert shell(*words).returncode == 0
    before = records(tmp_path)
    (tmp_path / "out/gate").unlink()
    log = next((tmp_path / "out/trials").glob("*/log.txt"))
    first = log.stat().st_mtime_ns
    rerun = started(environment, tmp_path, *words, "rerun=all")
    until(lambda: log.stat().st_mtime_ns != first, rerun)
    os.killpg(rerun.pid, signal.SIGKILL)
    rerun.communicate()
    assert records(tmp_path) == before


@pytest.mark.slow
def test_sweep_of_a_name_used_before_counts_its_own(nrsfm: Shell) -> None:
    assert "2 trials: 2 run." in nrsfm("run", *TINY, "sweep=again", "dataset.seed=0,1").stdout
    second = nrsfm("run", *TINY, "sweep=again", "dataset.seed=1,2")
    assert (second.returncode, "2 trials: 1 run, 1 done before." in second.stdout) == (0, True), second.stdout


@pytest.mark.slow
def test_sync_rebuilds_a_lost_tracker(shell: Shell, tmp_path: Path) -> None:
    assert shell("run", "-m", *TINY, "noise.level=0,0.02").returncode == 0
    before = [t.outcome for t in tracked(tmp_path)]
    for path in (tmp_path / "out").glob("mlflow.db*"):
        path.unlink()
    done = shell("sync")
    assert (done.returncode, "2 runs written" in done.stdout) == (0, True)
    assert sorted(o.key for o in before) == sorted(t.outcome.key for t in tracked(tmp_path))
    assert "0 runs written" in shell("sync").stdout


def test_failed_trials_run_again_when_asked(nrsfm: Shell, tmp_path: Path) -> None:
    words = ("run", "dataset=dance_yoga", "method=edsc")
    first = nrsfm(*words)
    assert first.returncode == 2
    assert "dance.mat is not there" in first.stderr
    again = nrsfm(*words, "rerun=failed")
    assert "1 trial: 1 run, 1 absent" in again.stdout
    assert len(tracked(tmp_path)) == 1


def test_tracker_out_of_reach_costs_no_result(shell: Shell, tmp_path: Path) -> None:
    done = shell(
        "run", *TINY, "tracking=server", "tracking.uri=http://127.0.0.1:9", MLFLOW_HTTP_REQUEST_MAX_RETRIES="0"
    )
    assert done.returncode == 2
    assert "nrsfm sync" in done.stderr
    assert [r["status"] for r in records(tmp_path).values()] == ["ok"]
    assert "1 run written" in shell("sync").stdout


def test_what_a_sweep_sweeps_is_told_everywhere(nrsfm: Shell, tmp_path: Path) -> None:
    """In the plan, the progress, the table and MLflow; and one trial tells its numbers again when it is done."""
    words = ("method=edsc", "dataset.points=8,9", "dataset.frames=12", "n_bodies=auto", "--config-dir", str(tmp_path))
    names = [f"person_face edsc n_bodies=auto dataset.points={n}" for n in (8, 9)]
    planned = nrsfm("plan", *words, COLUMNS="200").stdout
    done = nrsfm("run", *words)
    assert done.returncode == 0
    for name in names:
        assert name in planned
        assert re.search(rf"{re.escape(name)}: .*bodies \d", done.stderr), done.stderr
    assert re.search(r"person_face, points 8, seed|person_face, .*points 8", done.stdout)
    assert "EDSC, points" not in done.stdout
    client = Tracker(f"sqlite:///{tmp_path}/out/mlflow.db", tmp_path / "out").client
    assert sorted(client.get_run(run.run_id).info.run_name for run in tracked(tmp_path)) == names
    one = (*words[:1], "dataset.points=8", *words[2:])
    again = nrsfm("run", *one)
    assert "nothing to run" in again.stdout and "wrong " in again.stderr
