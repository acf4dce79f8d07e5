"""The entries of the metrics agree with each other, with the document, and with whatever reads them."""

from __future__ import annotations

import numpy as np
import pytest

from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate import metrics
from nrsfm.harness.evaluate.metric_type import Metric, needed
from nrsfm.methods.base import Reconstruction
from tests.shell import ROOT

DOCUMENT = ROOT / "docs/metrics.md"


def document_table() -> str:
    """The table of docs/metrics.md."""
    lines = ["| Name | In tables | Unit | Definition | Left out where |", "|---|---|---|---|---|"]
    for metric in metrics.METRICS:
        absent = f"{metric.absent}; the number of bodies was given" if metric.counted else metric.absent
        cells = (f"`{metric.name}`", metric.label, metric.unit, metric.definition, absent)
        lines.append(f"| {' | '.join(cells)} |".replace("|  |", "| |"))
    return "\n".join(lines)


def test_the_document_has_every_metric() -> None:
    assert document_table() in DOCUMENT.read_text(), f"put this table into {DOCUMENT}:\n{document_table()}"


def test_entries_name_each_other() -> None:
    assert len(metrics.BY_NAME) == len(metrics.METRICS)
    for metric in metrics.METRICS:
        assert {metric.beside, metric.counts} - {""} <= metrics.BY_NAME.keys()
        assert metric.definition and metric.absent and metric.tolerance > 0
        assert not metric.remark or metric.beside


def test_a_new_metric_is_one_entry(small_scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    tallest = Metric("height", lambda e: float(np.ptp(e.structure[:, 2])), "the height", brief="{:.1f} high")
    monkeypatch.setattr(metrics, "METRICS", (*metrics.METRICS, tallest))
    found = Reconstruction(structure=needed(small_scene.structure))
    values = metrics.evaluate(small_scene, found, known_cameras=True)
    assert values["height"] > 0
    assert metrics.brief({"height": 2.0, "n_wrong": 3.0}, 30) == ["wrong 3/30", "2.0 high"]
    assert "height" not in metrics.evaluate(small_scene, Reconstruction(), known_cameras=True)
