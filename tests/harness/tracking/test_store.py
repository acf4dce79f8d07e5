"""States of a SQLite store that people bring about: any path, moved, copied, deleted, renamed; each has its remedy."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from mlflow import MlflowClient

from nrsfm.harness.config.address import for_mlflow
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.tracking.tracker import EXPERIMENT, Tracker
from tests.harness.tracking.servers import free_port, wait_for
from tests.shell import ODD as NAUGHTY
from tests.shell import TINY, Shell, records, started, tracked

ODD = "a?b #c%20d;e&f='g@h"


def client(tmp_path: Path, folder: str = "out") -> MlflowClient:
    return MlflowClient(for_mlflow(f"sqlite:///{tmp_path}/{folder}/mlflow.db"))


def experiment(tmp_path: Path) -> str:
    found = client(tmp_path).get_experiment_by_name(EXPERIMENT)
    assert found is not None
    return str(found.experiment_id)


def test_any_signs_may_be_in_a_path(nrsfm: Shell, tmp_path: Path) -> None:
    """They are neither escaped twice nor taken for parts of an address."""
    place = {"NRSFM_OUTPUT": str(tmp_path / ODD / "out")}
    assert nrsfm("run", *TINY, **place).returncode == 0
    assert [path.name for path in tmp_path.iterdir()] == [ODD]
    assert sorted(path.name for path in (tmp_path / ODD / "out").iterdir() if path.suffix == ".db") == ["mlflow.db"]
    tracker = Tracker(f"sqlite:///{tmp_path}/{ODD}/out/mlflow.db", tmp_path / ODD / "out")
    (one,) = tracker.outcomes()
    artifact = tracker.artifact(one.run_id, "arrays.npz")
    assert artifact is not None and artifact.is_relative_to(tmp_path / ODD / "out")
    assert "0 runs written" in nrsfm("sync", **place).stdout
    assert f"{ODD}/out/mlflow.db: 1 run, " in nrsfm("doctor", **place).stdout


@pytest.mark.parametrize("how", ["moved", "copied", "linked"])
def test_a_folder_may_be_elsewhere(nrsfm: Shell, tmp_path: Path, how: str) -> None:
    """New artifacts stand in the new folder, the old ones are found there, and nothing is written twice."""
    assert nrsfm("run", *TINY).returncode == 0
    new, old = tmp_path / "new", tmp_path / "out"
    if how == "linked":
        new.symlink_to(old)
    elif how == "copied":
        shutil.copytree(old, new)
    else:
        old.rename(new)
    before = {path: path.stat().st_mtime_ns for path in old.rglob("*")} if how == "copied" else {}
    place = {"NRSFM_OUTPUT": str(new)}
    assert nrsfm("run", *TINY, "noise.level=0.02", **place).returncode == 0
    assert "0 runs written" in nrsfm("sync", **place).stdout
    tracker = Tracker(f"sqlite:///{new}/mlflow.db", new)
    runs = tracker.outcomes()
    assert [run.outcome.level for run in runs] == [0, 0.02]
    for run in runs:
        artifact = tracker.artifact(run.run_id, "arrays.npz")
        assert artifact is not None and artifact.is_relative_to(new)
    assert before == {path: path.stat().st_mtime_ns for path in before}
    if how == "moved":
        assert not old.exists()


def test_a_deleted_experiment_is_restored(nrsfm: Shell, tmp_path: Path) -> None:
    assert nrsfm("run", *TINY).returncode == 0
    client(tmp_path).delete_experiment(experiment(tmp_path))
    assert "'nrsfm sync' restores it" in nrsfm("doctor").stdout
    assert nrsfm("report", "quick", "--quiet").returncode == 2  # its trials are not run; nothing is in the way
    assert nrsfm("sync").returncode == 0
    assert len(tracked(tmp_path)) == 1
    client(tmp_path).delete_experiment(experiment(tmp_path))
    assert nrsfm("run", *TINY, "noise.level=0.02").returncode == 0
    assert len(tracked(tmp_path)) == 2
    assert "restores it" not in nrsfm("doctor").stdout


def test_deleted_runs_are_restored(nrsfm: Shell, tmp_path: Path) -> None:
    words = ("dataset.points=8", "dataset.frames=12", "method=edsc", "noise.level=0")
    assert nrsfm("run", "experiment=quick", *words).returncode == 0
    (one,) = tracked(tmp_path)
    client(tmp_path).delete_run(one.run_id)
    assert nrsfm("report", "quick", *words, "--quiet").returncode == 0  # the record is there
    assert "nothing to run" in nrsfm("run", "experiment=quick", *words).stdout
    assert "1 run written" in nrsfm("sync").stdout
    assert [run.run_id for run in tracked(tmp_path)] == [one.run_id]


def test_a_renamed_experiment_is_filled_anew(nrsfm: Shell, tmp_path: Path) -> None:
    assert nrsfm("run", *TINY).returncode == 0
    client(tmp_path).rename_experiment(experiment(tmp_path), "mine")
    assert nrsfm("run", *TINY, "noise.level=0.02").returncode == 0
    assert "1 run written" in nrsfm("sync").stdout
    assert len(tracked(tmp_path)) == 2
    assert client(tmp_path).get_experiment_by_name("mine") is not None


def test_a_store_that_is_lost_damaged_or_another_is_rebuilt(nrsfm: Shell, tmp_path: Path) -> None:
    assert nrsfm("run", *TINY).returncode == 0
    store = tmp_path / "out/mlflow.db"
    for content in (b"no database at all", b""):
        for path in store.parent.glob("mlflow.db*"):
            path.unlink()
        store.write_bytes(content)
        done = nrsfm("sync")
        if done.returncode == 3:
            assert "move the file away" in done.stderr
            store.unlink()
            assert "1 run written" in nrsfm("sync").stdout
        assert len(tracked(tmp_path)) == 1
    store.unlink()
    assert nrsfm("report", "quick", "--quiet").returncode == 2
    assert not store.exists()  # what reads makes none


def test_names_that_mlflow_refuses_are_written_all_the_same(nrsfm: Shell, tmp_path: Path) -> None:
    assert nrsfm("run", *TINY).returncode == 0
    (folder,) = (tmp_path / "out/trials").iterdir()
    record: dict[str, Any] = json.loads((folder / "result.json").read_text())
    record["parameters"]["dataset"] |= {"columns": {"x (px)": 1, "a/../b": 2, "k" * 300: 3, "é": 4}}
    record["parameters"]["dataset"] |= {f"key{i}": i for i in range(250)}
    (folder / "result.json").write_text(json.dumps(record))
    for path in (tmp_path / "out").glob("mlflow.db*"):
        path.unlink()
    done = nrsfm("sync")
    assert (done.returncode, done.stderr) == (0, "")
    (one,) = tracked(tmp_path)
    assert one.outcome == read_record(folder)
    params = client(tmp_path).get_run(one.run_id).data.params
    assert params["dataset.columns.x _px_"] == "1" and params["dataset.key249"] == "249"


def test_two_folders_on_one_store_leave_one_run_of_a_trial(nrsfm: Shell, tmp_path: Path) -> None:
    """That of the latest record, whichever is written first and last."""
    uri = f"tracking.uri=sqlite:///{tmp_path}/shared/mlflow.db"
    for name in ("a", "b", "c"):
        place = {"NRSFM_OUTPUT": str(tmp_path / name)}
        assert nrsfm("run", *TINY, **place).returncode == 0
    for name in ("b", "a", "c", "a", "b"):
        assert nrsfm("sync", uri, NRSFM_OUTPUT=str(tmp_path / name)).returncode == 0
    (one,) = Tracker(f"sqlite:///{tmp_path}/shared/mlflow.db", tmp_path / "a").outcomes()
    (folder,) = (tmp_path / "c/trials").iterdir()
    assert one.outcome == read_record(folder)


def test_trials_do_not_know_the_trackers_login(shell: Shell, tmp_path: Path) -> None:
    login = {"MLFLOW_TRACKING_USERNAME": "anna", "MLFLOW_TRACKING_PASSWORD": "hunter2"}
    assert shell("run", *NAUGHTY, "+method.how=login", **login).returncode == 2
    (record,) = records(tmp_path).values()
    assert record["error"].startswith("RuntimeError: the password is not known here")


@pytest.mark.slow
def test_two_folders_that_run_a_trial_at_one_moment_leave_one_run(environment: dict[str, str], tmp_path: Path) -> None:
    words = ("run", *NAUGHTY, "+method.how=slow", "noise.level=0.01", "noise.repeat=0,1,2", "workers=1")
    uri = f"sqlite:///{tmp_path}/shared/mlflow.db"
    places = [{"NRSFM_OUTPUT": str(tmp_path / name)} for name in "ab"]
    both = [started(environment | place, tmp_path, *words, f"tracking.uri={uri}") for place in places]
    ended = [process.communicate(timeout=1200) for process in both]
    assert [process.returncode for process in both] == [0, 0], ended
    runs = Tracker(uri, tmp_path / "c").outcomes()
    kept = [read_record(folder) for name in "ab" for folder in (tmp_path / name / "trials").iterdir()]
    latest = {key: max(r.finished for r in kept if r and r.key == key) for key in {r.key for r in kept if r}}
    assert {run.outcome.key: run.outcome.finished for run in runs} == latest
    assert len(runs) == len(latest) == 3


@pytest.fixture
def interface(environment: dict[str, str], tmp_path: Path, nrsfm: Shell) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """``nrsfm ui`` on a store that was moved, and the address that it prints."""
    assert nrsfm("run", *TINY, NRSFM_OUTPUT=str(tmp_path / "before")).returncode == 0
    (tmp_path / "before").rename(tmp_path / "out")
    process = started(environment, tmp_path, "ui", "--port", str(free_port()))
    assert process.stdout is not None
    yield process, process.stdout.readline().split()[0]
    if process.poll() is None:
        process.kill()


@pytest.mark.slow
def test_the_interface_shows_artifacts_of_a_moved_store_and_leaves_no_process(
    interface: tuple[subprocess.Popen[str], str], tmp_path: Path
) -> None:
    process, page = interface
    home = page.partition("/#")[0]
    wait_for(home, process)  # type: ignore[arg-type]
    (one,) = tracked(tmp_path)
    assert page.endswith(f"/#/experiments/{experiment(tmp_path)}?workflowType=machine_learning")
    with urllib.request.urlopen(f"{home}/get-artifact?run_uuid={one.run_id}&path=result.json") as answer:
        assert json.load(answer)["key"] == one.outcome.key
    below = psutil.Process(process.pid).children(recursive=True)
    assert sum("uvicorn" in " ".join(child.cmdline()) for child in below) >= 1
    process.send_signal(signal.SIGTERM)
    process.wait(60)
    _, alive = psutil.wait_procs(below, timeout=30)
    assert alive == []
