"""``nrsfm.results``: finished trials as a pandas DataFrame, with the numbers of the report's tables."""

from __future__ import annotations

import csv
from pathlib import Path

import pandas as pd
import pytest

import nrsfm as package
from nrsfm import results
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.outcome import Outcome
from tests.fuzz import files
from tests.harness.record.test_foreign import record
from tests.shell import TINY, Shell, records

COLUMNS = ["dataset", "method", "cameras", "placement", "motion", "level", "gaps", "repeat"]


def table(path: Path) -> dict[tuple[str, str, str, str], float]:
    """The measured numbers of a report's CSV file, without its rows of means."""
    with path.open() as stream:
        return {
            (row["dataset"], row["method"], row["level"], row["measured_metric"]): float(row["measured"])
            for row in csv.DictReader(stream)
            if row["measured"] and row["dataset"]
        }


def test_a_groupby_gives_the_numbers_of_the_reports_table(nrsfm: Shell, tmp_path: Path) -> None:
    words = ("dataset.points=8", "dataset.frames=12", "method=edsc,ssc2d", "noise.level=0,0.02", "noise.repeat=0,1")
    assert nrsfm("run", "experiment=quick", *words).returncode == 0
    assert nrsfm("report", "quick", *words, "--quiet").returncode == 0
    trials = results(tmp_path / "out")
    means = trials.groupby(["dataset", "method", "level"])[["e_ms", "n_wrong"]].mean()
    cells = table(tmp_path / "out/report/quick.csv")
    assert len(cells) >= 4
    for (dataset, method, level, metric), measured in cells.items():
        assert means.loc[(dataset, method, float(level)), metric] == pytest.approx(measured, rel=1e-12)


def test_a_row_a_trial_and_a_column_a_metric(nrsfm: Shell, tmp_path: Path) -> None:
    assert nrsfm("run", "-m", *TINY, "noise.level=0,0.02").returncode == 0
    trials = results(str(tmp_path / "out"))
    written = records(tmp_path)
    assert list(trials.columns[:8]) == COLUMNS
    assert list(trials.columns[-8:]) == [
        "seconds",
        "cpu_seconds",
        "peak_mb",
        "status",
        "error",
        "sweep",
        "finished",
        "key",
    ]
    assert trials.set_index("key").level.to_dict() == {key: values["level"] for key, values in written.items()}
    for row in trials.to_dict("records"):
        one = written[str(row["key"])]
        assert {name: row[name] for name in one["metrics"]} == one["metrics"]
        assert row["finished"] == pd.Timestamp(one["finished"])
    assert trials.finished.is_monotonic_increasing


def test_an_experiment_has_a_row_for_each_of_its_trials(nrsfm: Shell, tmp_path: Path) -> None:
    """Those that have not run are missing, and trials of no such experiment are left out."""
    assert nrsfm("run", *TINY).returncode == 0
    assert nrsfm("run", "experiment=quick", "method=edsc", "noise.level=0").returncode == 0
    trials = results(tmp_path / "out", experiment="quick")
    assert list(trials.columns[:8]) == COLUMNS
    assert len(trials) == 10 and trials.key.is_unique
    done, missing = trials[trials.status == "ok"], trials[trials.status == "missing"]
    assert (done.method.tolist(), len(missing)) == (["edsc"], 9)
    assert done.e_ms.notna().all() and missing.e_ms.isna().all()


def test_failed_trials_are_rows_and_damaged_records_are_not(tmp_path: Path) -> None:
    record(tmp_path / "trials", files.record(status="timeout", metrics={}, error="took more than 1 s"))
    record(tmp_path / "trials", "{", key="damaged")
    (row,) = results(tmp_path).to_dict("records")
    assert (row["status"], row["error"]) == ("timeout", "took more than 1 s")


def test_no_trials_make_an_empty_table(tmp_path: Path) -> None:
    (tmp_path / "trials").mkdir()
    trials = results(tmp_path)
    assert trials.empty and list(trials.columns[:8]) == COLUMNS


def test_a_folder_or_experiment_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"trials is missing; name the folder that 'nrsfm run' wrote to"):
        results(tmp_path)
    (tmp_path / "trials").mkdir()
    with pytest.raises(UsageError, match="no_such"):
        results(tmp_path, experiment="no_such")


def test_the_name_is_public() -> None:
    assert "results" in dir(package) and "results" in package.__all__


def test_a_record_of_half_a_surrogate_pair_is_read_back() -> None:
    """As in a file name that is not UTF-8: JSON could hold it, and strict readers refuse it."""
    outcome = Outcome.from_json(files.record())
    text = Outcome(**{**vars(outcome), "error": "a\ud800b"}).to_json()
    assert Outcome.from_json(text).error == "a?b"
