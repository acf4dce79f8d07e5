"""The figure of scaling shows every trial, and the exponent that it was made with."""

from __future__ import annotations

import numpy as np
import pytest

from reports.scaling import measured, scaling


def test_scaling_shows_every_trial_and_its_exponent() -> None:
    sizes = np.array([500, 1000, 2000, 4000, 8000])
    trials = [
        measured(P, F, [9.0] * 5 + [F * P**2 * 1e-9] * 5, [F * P**1.5] * 10, 100.0 + P) for P in sizes for F in (10, 99)
    ]
    assert trials[0].seconds == pytest.approx(10 * 500**2 * 1e-9), "the first half is not counted"
    seconds, operations, memory = scaling(trials).axes
    assert [line.get_label() for line in seconds.lines] == ["F = 10, P^2.00", "F = 99, P^2.00"]
    assert operations.lines[0].get_label() == "F = 10, P^1.50"
    np.testing.assert_allclose(memory.lines[1].get_xydata(), np.column_stack([sizes, 100.0 + sizes]))
