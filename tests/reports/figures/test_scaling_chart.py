"""The figure of scaling shows every trial, and the exponent that it was made with."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from nrsfm.harness.evaluate.metric_type import needed
from nrsfm.reports.figures.scaling_chart import scaling
from tests.reports.conftest import make_answer


def test_scaling_shows_every_trial_and_its_exponent() -> None:
    sizes = np.array([500, 1000, 2000, 4000, 8000])
    curves: dict[str, dict[str, Any]] = {}
    runs = []
    for P, F in itertools.product(sizes.tolist(), (10, 99)):
        _, run = make_answer(f"scene_{P}_{F}", "ours_c")
        run = replace(needed(run), outcome=replace(needed(run).outcome, n_points=P, n_frames=F, peak_mb=100.0 + P))
        curves[run.outcome.key] = {
            "history_seconds": np.array([9.0] * 5 + [F * P**2 * 1e-9] * 5),  # the first half is not counted
            "history_operations": np.array([F * P**1.5] * 10),
        }
        runs.append(run)
    seconds, operations, memory = scaling(runs, lambda run: curves[run.outcome.key])
    assert seconds.title == "CPU seconds an iteration: P^2.00, P^2.00"
    assert [series.label for series in seconds.series] == ["F = 10", "F = 99"]
    assert seconds.series[0].y[0] == pytest.approx(10 * 500**2 * 1e-9)
    assert operations.title.endswith(": P^1.50, P^1.50")
    assert memory.series[1].x == pytest.approx(sizes)
    assert memory.series[1].y == pytest.approx(100.0 + sizes)
    assert all(panel.log_x and panel.log_y for panel in (seconds, operations, memory))
    assert list(scaling([], lambda run: {})) == []
