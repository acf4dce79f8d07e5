"""The table of a sweep that no layout is for."""

from __future__ import annotations

import pytest

from nrsfm.harness.config.spans import expand
from nrsfm.reports.layouts.index import layout
from nrsfm.reports.layouts.sweep_table import span
from nrsfm.reports.tables.build import build


def headings(*overrides: str) -> list[str]:
    return [method.label or method.name for method in span([trial for trial, _ in expand(overrides)]).methods]


def test_columns_are_settings_of_methods_and_rows_those_of_scenes() -> None:
    assert headings("method=ours,edsc", "dataset.frames=12,24", "noise.level=0,0.02") == ["ours", "edsc"]
    assert headings("method=ours,edsc", "dataset.points=8,9") == ["ours", "edsc"]
    found = headings("method=adaptive", "method.whitening=[0.5,0.5],[0.7,0.5]", "cameras=known,estimated")
    assert len(found) == 2 and all(name.startswith("Adaptive (this project), whitening [") for name in found)
    assert headings("method=ours", "cameras=estimated", "cameras.rank=5,6") == ["Ours, rank 5", "Ours, rank 6"]


@pytest.mark.parametrize("experiment", [None, "quick", "table2"])
def test_every_cell_of_a_swept_scene_has_one_trial(experiment: str | None) -> None:
    """In the layout of a sweep and of an experiment."""
    words = ["method=ours,bmm_ssc3d", "dataset=procedural", "dataset.points=8,9", "dataset.seed=0,1", "noise.level=0"]
    trials = [trial for trial, _ in expand(words if experiment is None else [f"experiment={experiment}", *words])]
    design = layout(experiment) if experiment else span(trials)
    table = build(experiment or "sweep", [(trial, None) for trial in trials], design)
    asked = [row for row in table.rows if "points" in row.setting.scene]
    told = [f"points {n}, seed {k}" for n in (8, 9) for k in (0, 1)]
    assert [row.setting.scene.removeprefix("frames 120, ") for row in asked] == told
    assert all(row.setting.scene in row.label for row in asked)
    for row in asked:
        pairs = zip(row.cells, table.columns, strict=True)
        assert {c.reason for c, column in pairs if column.method in ("ours", "bmm_ssc3d")} == {"not run"}, row.label
