"""A plan agrees with the run of the same overrides."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from nrsfm.harness.config.spans import expand
from nrsfm.harness.trial.execute import execute
from tests.shell import TINY, Shell, records

THREE = (*TINY, "method.clusterer.dimension=4,0,3")

Run = Callable[..., None]


@pytest.fixture
def ran(tmp_path: Path) -> Run:
    """Run trials without a tracker."""

    def call(*words: str) -> None:
        for trial, settings in expand([*words, f"output={tmp_path}/out", f"data={tmp_path}/no-data"]):
            execute(trial, settings)

    return call


def test_it_counts_what_the_run_does(nrsfm: Shell, ran: Run) -> None:
    """One trial is done, one failed, one missing."""
    ran(*TINY, "method.clusterer.dimension=4,0")
    expected = {"none": (1, "1 done, 1 failed, 1 missing"), "failed": (2, "1 done, 1 failed, again, 1 missing")}
    expected |= {"all": (3, "1 done, again, 1 failed, again, 1 missing"), "stale": (1, "1 done, 1 failed, 1 missing")}
    for rerun, (n, counts) in expected.items():
        planned = nrsfm("plan", "-m", *THREE, f"rerun={rerun}")
        assert f"3 trials: {counts}.\nTo run: {n}." in planned.stdout, rerun
        assert ("1 that failed are not repeated; rerun=failed" in planned.stdout) == (rerun in ("none", "stale"))
        assert planned.returncode == (0 if n > 1 else 2)
    assert "3 trials: 2 run, 1 done before" in nrsfm("run", "-m", *THREE, "rerun=failed").stdout
    assert "3 trials: 3 run" in nrsfm("run", "-m", *THREE, "rerun=all").stdout
    after = nrsfm("plan", *THREE).stdout
    assert "Nothing to run." in after
    assert "dimension is 0" in after


def test_time_is_that_of_past_trials_of_the_size(nrsfm: Shell, ran: Run, tmp_path: Path) -> None:
    first = nrsfm("plan", *TINY)
    assert "no past trial of this method" in first.stdout
    assert "1 trial of unknown length" in first.stdout
    ran(*TINY)
    (path,) = (tmp_path / "out/trials").glob("*/result.json")
    record = json.loads(path.read_text()) | {"seconds": 50.0, "cpu_seconds": 20.0}
    path.write_text(json.dumps(record))
    words = (*TINY, "noise.level=0.01", "noise.repeat=range(5)", "workers=2")
    planned = nrsfm("plan", *words).stdout
    assert planned.count("from 1 trial of this size") == 5
    assert "Expected: 2.5 min on 2 workers" in planned
    assert "100 s of CPU time" in planned
    assert "are free" in planned
    larger = nrsfm("plan", *TINY, "dataset.points=16").stdout
    assert "no past trial of this size; 16 tracks, 12 frames took 50 s" in larger
    assert "1 trial of unknown length" in larger
    warned = nrsfm("plan", *words, "limits.seconds=30", "limits.sweep_seconds=60").stdout
    assert "! 5 trials are expected to take longer than limits.seconds = 30; raise it" in warned
    assert "! limits.sweep_seconds = 60 ends the run before" in warned


def test_a_disk_that_is_too_small_is_told(
    nrsfm: Shell, ran: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran(*TINY)
    words = (*TINY, "noise.level=0.01", "noise.repeat=range(3)")
    assert nrsfm("plan", *words).returncode == 0
    monkeypatch.setattr("nrsfm.harness.sweep.plan.free_mb", lambda place: 0.01)
    planned = nrsfm("plan", *words)
    assert planned.returncode == 2
    assert f"! {tmp_path}/out: 0.01 MB are free and about" in planned.stdout
    assert "set NRSFM_OUTPUT to a larger disk" in planned.stdout


def test_more_memory_than_the_machine_has_is_told(nrsfm: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nrsfm.harness.sweep.plan.machine_mb", lambda: 500.0)
    words = (*TINY, "noise.level=0.01", "noise.repeat=0,1,2")
    assert "3 trials side by side may take 922 MB and this machine has 500 MB; lower workers" in (
        nrsfm("plan", *words, "workers=3").stdout
    )
    assert "side by side" not in nrsfm("plan", *words, "workers=1").stdout


def test_a_long_plan_is_told_by_method_and_state(nrsfm: Shell, ran: Run) -> None:
    words = ("dataset.points=8", "dataset.frames=12", "method=edsc,ssc2d", "noise.level=0.01", "noise.repeat=range(30)")
    ran(*TINY, "noise.level=0.01", "noise.repeat=3")
    short = nrsfm("plan", *words).stdout
    assert len(short.splitlines()) == 1 + 3 + 2  # headings, groups, sums
    groups = [line.split()[:3] for line in short.splitlines()[1:4]]
    assert groups == [["edsc", "missing", "29"], ["edsc", "done", "1"], ["ssc2d", "missing", "30"]]
    whole = nrsfm("plan", *words, "--all").stdout
    assert sum(line.startswith("person_face ") for line in whole.splitlines()) == 60
    assert "person_face ssc2d noise=0.01#29" in whole


def test_machines_get_json(nrsfm: Shell, ran: Run, tmp_path: Path) -> None:
    ran(*TINY)
    done = nrsfm("plan", *TINY, "noise.level=0,0.01", "method=edsc,ssc2d", "--json")
    found = json.loads(done.stdout)
    assert found["counts"] == {"done": 1, "missing": 3}
    assert (found["to_run"], found["unknown"], len(found["trials"])) == (3, 2, 4)
    by_title = {row["title"]: row for row in found["trials"]}
    (key,) = records(tmp_path)
    assert by_title["person_face edsc"]["key"] == key
    again = by_title["person_face edsc noise=0.01#0"]
    assert (again["runs"], again["basis"], again["state"]) == (True, "1 trial of this size", "missing")
    assert again["seconds"] == pytest.approx(records(tmp_path)[key]["seconds"], abs=1e-3)
    assert "seconds" not in by_title["person_face ssc2d"]


def test_it_refuses_what_the_run_refuses(nrsfm: Shell) -> None:
    for verb in ("plan", "run"):
        refused = nrsfm(verb, *TINY, "hydra/launcher=submitit_slurm")
        assert refused.returncode == 3
        assert "set how many Slurm jobs share the trials, as in workers=20" in refused.stderr


def test_lines_of_the_table_fit_where_there_is_no_terminal(nrsfm: Shell) -> None:
    planned = nrsfm("plan", *TINY, "noise.level=0.01", "noise.repeat=0,1").stdout
    assert max(map(len, planned.splitlines()[:3])) <= 120
