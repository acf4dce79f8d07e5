"""BreathingClouds keeps the contract of every dataset, and its bodies deform as documented."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nrsfm.harness.testing import Check, parametrize_with_checks
from nrsfm_example.breathing_clouds import load

SETTINGS = {"name": "breathing_clouds", "points": 20, "frames": 50, "seed": 0}


@parametrize_with_checks("dataset=breathing_clouds")
def test_contract(check: Check) -> None:
    check()


def test_two_bodies_of_a_few_shapes() -> None:
    scene = load(SETTINGS, Path())
    assert scene.bodies == ("slow", "fast")
    assert np.linalg.matrix_rank(scene.structure.reshape(50, -1), tol=1e-6) == 3  # at rest, and a swing of each


def test_a_scene_of_too_few_points_is_refused() -> None:
    with pytest.raises(ValueError, match="points"):
        load({**SETTINGS, "points": 1}, Path())
