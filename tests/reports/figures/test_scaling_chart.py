"""The figure of scaling shows every trial, and the exponent that it was made with."""

from __future__ import annotations

import numpy as np
import pytest

from nrsfm.reports.figures.scaling_chart import measured, scaling


def test_scaling_shows_every_trial_and_its_exponent() -> None:
    sizes = np.array([500, 1000, 2000, 4000, 8000])
    trials = [
        measured(P, F, [9.0] * 5 + [F * P**2 * 1e-9] * 5, [F * P**1.5] * 10, 100.0 + P) for P in sizes for F in (10, 99)
    ]
    assert trials[0].seconds == pytest.approx(10 * 500**2 * 1e-9), "the first half is not counted"
    seconds, operations, memory = scaling(trials)
    assert seconds.title == "CPU seconds an iteration: P^2.00, P^2.00"
    assert [series.label for series in seconds.series] == ["F = 10", "F = 99"]
    assert operations.title.endswith(": P^1.50, P^1.50")
    assert memory.series[1].x == pytest.approx(sizes)
    assert memory.series[1].y == pytest.approx(100.0 + sizes)
    assert all(panel.log_x and panel.log_y for panel in (seconds, operations, memory))
    assert list(scaling([])) == []
