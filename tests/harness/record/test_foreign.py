"""Trial folders, journals and stores that somebody else may have written: nothing in them is believed unseen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nrsfm.datasets.errors import DatasetError
from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import read_arrays, read_record
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.tracked import Tracked
from nrsfm.harness.sweep.work import Work
from nrsfm.harness.tracking.trial_runs import Arrays
from nrsfm.harness.trial.journal import Entry, entries
from nrsfm.harness.trial.progress import steps
from tests.fuzz import files
from tests.shell import Shell, tracked

KEY = "0123456789abcdef"
DEEP = "[" * 50_000


def record(folder: Path, text: bytes | str, key: str = KEY) -> Path:
    place = folder / key / "result.json"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(text.encode() if isinstance(text, str) else text)
    return place.parent


def test_a_record_is_read(tmp_path: Path) -> None:
    outcome = read_record(record(tmp_path, files.record()))
    assert outcome is not None and outcome.metrics == {"e_3d": 0.03, "n_wrong": 1.0}
    assert Outcome.from_json(files.record(cpu_cores=3, later={"a": 1}).decode()) == outcome, "fields of later versions"


@pytest.mark.parametrize(
    "changes",
    [
        {"key": ["a"]},
        {"key": "../../etc"},
        {"key": "' OR tags.trial_key != '"},
        {"key": ...},
        {"status": "fine"},
        {"status": ["ok"]},
        {"dataset": 3},
        {"level": "0"},
        {"level": float("nan")},
        {"level": True},
        {"repeat": -1},
        {"repeat": 10**30},
        {"n_points": "116"},
        {"n_bodies": 2.5},
        {"metrics": []},
        {"metrics": {"e_3d": "0.03"}},
        {"metrics": {"e_3d": float("inf")}},
        {"metrics": {"e_3d": 10**400}},
        {"metrics": {"<script>": 1.0}},
        {"seconds": float("inf")},
        {"seconds": -1},
        {"error": {"a": 1}},
        {"finished": "yesterday"},
        {"finished": "0001-01-01T00:00:00+00:00"},
        {"finished": 5},
        {"parameters": []},
        {"parameters": {"dataset": 3}},
        {"parameters": {"gaps": {"kind": "random"}}},
        {"parameters": {"gaps": {"kind": [], "share": 0.5}}},
        {"environment": {"python": 3}},
        {"stand_in": "no"},
    ],
    ids=str,
)
def test_a_record_that_is_none(tmp_path: Path, changes: dict[str, Any]) -> None:
    text = files.record(**changes)
    assert read_record(record(tmp_path, text)) is None
    with pytest.raises(ValueError, match=r"record|status"):
        Outcome.from_json(text.decode())


@pytest.mark.parametrize("text", [DEEP, '{"key": ' + "9" * 5000 + "}", "null", b"\xff\xfe", b" " * (5 << 20)])
def test_a_file_that_is_no_record(tmp_path: Path, text: bytes | str) -> None:
    assert read_record(record(tmp_path, text)) is None


def test_a_record_of_another_trial(tmp_path: Path) -> None:
    """It would take the place of that trial's run in the tracker."""
    assert read_record(record(tmp_path, files.record(), key="fedcba9876543210")) is None


def test_damaged_folders_are_named_and_harm_no_other(nrsfm: Shell, tmp_path: Path) -> None:
    from mlflow import MlflowClient

    trials = tmp_path / "out/trials"
    record(trials, files.record())
    record(trials, files.record(), key="of_another")
    record(trials, DEEP, key="deep")
    odd = record(trials, files.record(key="arrays"), key="arrays")
    (odd / "arrays.npz").write_bytes(files.npz({"tracks": np.array([{}], dtype=object)}))
    (trials / "empty").mkdir()
    done = nrsfm("sync")
    assert done.returncode == 2 and "1 run written" in done.stdout
    lines = done.stderr.splitlines()
    assert len(lines) == 3 and all(line.startswith("nrsfm sync: ") for line in lines)
    assert [name for name in ("arrays", "deep", "of_another") if any(f"{trials / name}" in line for line in lines)] == [
        "arrays",
        "deep",
        "of_another",
    ]
    assert "holds objects" in lines[0]
    client = MlflowClient(f"sqlite:///{tmp_path}/out/mlflow.db")
    (experiment,) = (e for e in client.search_experiments() if e.name == "nrsfm")
    for text in (DEEP[:5000], '{"key": 3}', json.dumps({"metrics": []}), "null"):  # of a stranger's store
        run = client.create_run(experiment.experiment_id)
        client.set_tag(run.info.run_id, "record", text)
    assert [t.outcome.key for t in tracked(tmp_path)] == [KEY]


# Arrays


def arrays(folder: Path, **changes: Any) -> Path:
    held = files.trial_arrays() | changes
    path = folder / "arrays.npz"
    path.write_bytes(files.npz({name: value for name, value in held.items() if value is not None}))
    return path


def test_arrays_are_read(tmp_path: Path) -> None:
    read = read_arrays(arrays(tmp_path, frame_e_3d=None, cameras=None))
    assert read["affinity"].shape == (files.P, files.P) and read["affinity"].nnz == 6
    assert read["tracks"].shape == (files.F, 2, files.P)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"affinity_size": np.array(2**31 - 1)}, "not of 6 tracks"),
        ({"affinity_size": np.array([6])}, "'affinity_size' has shape"),
        ({"affinity_rows": np.array([0, 1, 6])}, "not in 0..5"),
        ({"affinity_rows": np.array([0, 1])}, "parts of the affinity"),
        ({"affinity_columns": None}, "parts of the affinity"),
        ({"x_size": np.array(10**9)}, "'x_size', which no trial writes"),
        ({"../../x": np.array(1)}, "which no trial writes"),
        ({"labels": np.array([0, 0, 0, 1, 1, 6])}, "not in 0..5"),
        ({"labels": np.array([0.5] * 6)}, "'labels' holds float64"),
        ({"labels": np.array([0, 1])}, "'labels' has shape"),
        ({"true_labels": np.array([0, 0, 0, 1, 1, -1])}, "not in 0..5"),
        ({"structure": np.zeros((3, files.F, files.P))}, "'structure' has shape"),
        ({"edges": np.array([[0, 9]])}, "not in 0..5"),
        ({"tracks": np.zeros((0, 2, files.P))}, "'tracks' has shape"),
        ({"tracks": None}, "does not fit the tracks"),
        ({"frame_e_3d": np.array(["a"] * files.F)}, "holds <U1"),
        ({"history_a": np.zeros((2, 2))}, "'history_a' has shape"),
    ],
)
def test_arrays_that_do_not_fit(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    path = arrays(tmp_path, **changes)
    with pytest.raises(DatasetError, match=said) as caught:
        read_arrays(path)
    assert str(path) in str(caught.value) and str(caught.value).isprintable()


def test_a_store_cannot_name_a_folder(tmp_path: Path) -> None:
    """The ids of runs come from the tracking server; arrays are fetched into a folder of that name."""
    fetch = Arrays(Settings(tmp_path, tmp_path, f"sqlite:///{tmp_path}/mlflow.db"))
    outcome = Outcome.from_json(files.record().decode())
    with pytest.raises(UsageError, match=r"'\.\./\.\./x' is not a run's id"):
        fetch(Tracked(outcome, "../../x", ""))
    assert not (tmp_path / "fetched").exists()


# Journals, steps and work


def test_lines_that_are_no_entries_are_passed_over(tmp_path: Path) -> None:
    good = '{"key": "a", "title": "b", "status": "ok", "ran": true}'
    lines = ["", "null", DEEP, "{}", good, good.replace("true", "1"), good.replace('"ok"', '"fine"'), "\x1b[2J", good]
    path = tmp_path / "trials.jsonl"
    path.write_text("\n".join(lines) + "\n" + good[:20])
    found = list(entries(path))
    assert [entry for entry, _ in found] == [Entry("a", "b", "ok", True)] * 2
    assert found[-1][1] == path.stat().st_size - 20


@pytest.mark.parametrize("change", [{"residuals": 3}, {"residuals": {"a": "b"}}, {"iteration": "1"}, {"title": ...}])
def test_a_step_that_is_none(tmp_path: Path, change: dict[str, Any]) -> None:
    held = {"title": "a", "iteration": 1, "iterations": 2, "residuals": {"shape": 0.1}} | change
    place = tmp_path / "sweeps/x/running"
    place.mkdir(parents=True)
    (place / "a.json").write_text(json.dumps({k: v for k, v in held.items() if v is not ...}))
    (place / "b.json").write_text(json.dumps({"title": "b", "iteration": 1, "iterations": 2, "residuals": {}}))
    assert [key for key, _ in steps(tmp_path, "x")] == ["b"]


@pytest.mark.parametrize(
    "text", ["", "{}", DEEP, '{"jobs": [{}]}', '{"jobs": [], "since": "", "until": 1, "home": "a"}', '{"jobs": 3}']
)
def test_work_that_is_none(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.work"
    path.write_text(text)
    with pytest.raises(UsageError, match=r"a\.work is no list of trials"):
        Work.read(path)
