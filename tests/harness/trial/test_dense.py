"""Dense trials: too large ones are refused, affinities stay sparse, and the progress of a trial can be read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import Request, expand
from nrsfm.harness.evaluate.errors import affinity_between
from nrsfm.harness.record import folder as storage
from nrsfm.harness.sweep.plan import plan
from nrsfm.harness.tracking.tracker import Tracker
from nrsfm.harness.tracking.trial_runs import answers
from nrsfm.harness.trial.execute import execute
from nrsfm.harness.trial.progress import Reporter, forget, place, steps
from nrsfm.reports.tables.build import build

SURFACES = ["dataset.bodies=[face,heart]", "dataset.points=30", "dataset.frames=10", "method=ours_c"]


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(output=tmp_path, data=tmp_path / "data", tracking_uri=f"sqlite:///{tmp_path}/mlflow.db", sweep="s")


def test_an_implicit_trial_keeps_its_affinity_sparse(settings: Settings) -> None:
    trial = expand([*SURFACES, "method.form=implicit", "method.max_iter=60"])[0][0]
    outcome, _ = execute(trial, settings)
    assert outcome.status == "ok", outcome.error
    with np.load(settings.trials / outcome.key / storage.ARRAYS, allow_pickle=False) as stored:
        assert "affinity" not in stored
        arrays = storage.unpack(stored)
    A = arrays["affinity"]
    assert sp.issparse(A) and A.shape == (60, 60) and abs(A - A.T).max() == 0
    between = affinity_between(A.toarray(), arrays["true_labels"])
    assert affinity_between(A, arrays["true_labels"]) == pytest.approx(between)
    assert outcome.metrics["affinity_between"] == pytest.approx(between, rel=1e-4)
    assert not list(steps(settings.output, "s")), "no trial is running any more"


def test_what_does_not_fit_is_refused_with_the_remedy(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    words = [*SURFACES[:1], "dataset.points=4000", "dataset.frames=10", "method=ours_c", "method.form=dense"]
    trial, composed = expand([*words, "limits.memory_gb=1"])[0]
    outcome, _ = execute(trial, replace(settings, memory_gb=1.0))
    assert outcome.status == "failed"
    assert "8000 tracks over 10 frames need about 5" in outcome.error and "dataset.points" in outcome.error
    assert outcome.peak_mb is not None and outcome.peak_mb < 500, "no memory was taken"
    monkeypatch.setenv("NRSFM_OUTPUT", str(composed.output / "elsewhere"))
    [dense] = plan([*words, "limits.memory_gb=1"]).trials
    assert dense.state == "cannot run" and "limits.memory_gb is 1" in dense.reason
    [implicit] = plan([*words[:-1], "limits.memory_gb=1"]).trials
    assert implicit.state == "missing" and implicit.memory_mb is not None and implicit.memory_mb < 1024


def test_rows_of_table4_without_data_are_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NRSFM_OUTPUT", str(tmp_path / "out"))
    monkeypatch.setenv("NRSFM_DATA", str(tmp_path / "none"))
    jobs = expand(["experiment=table4", "dataset.face=1", "missing=stand_in"])
    settings = jobs[0][1]
    tracker = Tracker(settings.tracking_uri, settings.output)
    for trial, _ in jobs:
        outcome, _ = execute(trial, settings)
        assert outcome.status == "absent"
        tracker.log(outcome, settings.trials / outcome.key)
    table = build("table4", answers(Request.of(["experiment=table4", "dataset.face=1"]))[0])
    assert [row.label for row in table.rows] == ["face1", "face2", "face3", "face4"]
    assert [cell.published for cell in table.rows[0].cells] == ["0.0749", "0.0745"]
    assert all(cell.reason == "absent" for cell in table.rows[0].cells)
    assert any("is not there" in text for text in table.loud)
    assert all(cell.measured is None for _, _, cell in table.cells())


def test_the_progress_of_a_trial_can_be_read(settings: Settings) -> None:
    path = place(settings.output, "s", "k1")
    assert path is not None and place(settings.output, "", "k1") is None
    report = Reporter("dense [ours]", path)
    report.stage("structure")
    [(_, step)] = steps(settings.output, "s")
    assert step.words == "structure"  # written at once, since a stage may be long
    report(7, 250, {"shape": 0.0123, "code": 2e-5})
    report(8, 250, {"shape": 0.1, "code": 0.1})  # within the interval between two writes
    [(key, step)] = steps(settings.output, "s")
    assert (key, step.title) == ("k1", "dense [ours]")
    assert step.words == "structure 7/250: shape 1e-02, code 2e-05"
    forget(path)
    assert not list(steps(settings.output, "s")) and not list(path.parent.iterdir())
