"""The table of a sweep that no layout is for."""

from __future__ import annotations

from nrsfm.harness.config.spans import expand
from nrsfm.reports.layouts.sweep_table import span


def headings(*overrides: str) -> list[str]:
    return [method.label or method.name for method in span([trial for trial, _ in expand(overrides)]).methods]


def test_columns_are_the_settings_that_no_row_tells() -> None:
    assert headings("method=ours,edsc", "dataset.frames=12,24", "noise.level=0,0.02") == ["ours", "edsc"]
    found = headings("method=ours,edsc", "dataset.points=8,9")
    assert sorted(found) == ["EDSC, points 8", "EDSC, points 9", "Ours, points 8", "Ours, points 9"]
    found = headings("method=adaptive", "method.whitening=[0.5,0.5],[0.7,0.5]", "cameras=known,estimated")
    assert len(found) == 2 and all(name.startswith("Adaptive (this project), whitening [") for name in found)
    assert headings("method=ours", "cameras=estimated", "cameras.rank=5,6") == ["Ours, rank 5", "Ours, rank 6"]


def test_every_trial_has_a_column_of_its_own_method() -> None:
    trials = [trial for trial, _ in expand(["method=ours,bmm_ssc3d", "dataset.points=8,9", "dataset.seed=0,1"])]
    layout = span(trials)
    assert len(layout.methods) == 8
    for trial in trials:
        held = [m for m in layout.methods if m.holds({"dataset": trial.dataset, "method": trial.method})]
        assert [m.name for m in held] == [trial.method["name"]]
