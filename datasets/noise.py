"""Image noise, reproducible from what it is added to."""

from __future__ import annotations

import hashlib

import numpy as np

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError


def seed(scene: str, level: float, repeat: int) -> int:
    """A seed that depends on the scene's name, the noise level and the repeat alone, never on the method."""
    text = f"{scene}|{float(level)!r}|{int(repeat)}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def add_noise(tracks: Array, level: float, repeat: int, scene: str) -> Array:
    """Zero-mean Gaussian noise of standard deviation ``level * max|W|`` on (F, 2, P) tracks; NaN stays NaN.

    Raises
    ------
    DatasetError
        If the level is negative or not finite, or the repeat is negative.
    """
    if not (np.isfinite(level) and level >= 0):
        raise DatasetError(f"noise.level is {level}, wanted a number >= 0 (a share of the largest image coordinate)")
    if repeat < 0:
        raise DatasetError(f"noise.repeat is {repeat}, wanted 0, 1, 2, ...")
    if level == 0:
        return tracks
    rng = np.random.default_rng(seed(scene, level, repeat))
    return tracks + level * np.nanmax(np.abs(tracks)) * rng.standard_normal(tracks.shape)
