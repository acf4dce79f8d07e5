"""Image noise, reproducible from what it is added to."""

from __future__ import annotations

import hashlib

import numpy as np

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError


def seed(scene: str, level: float, repeat: int) -> int:
    """Seed from the scene's name, the noise level and the repeat; it is the same for every method."""
    text = f"{scene}|{float(level)!r}|{int(repeat)}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def add_noise(tracks: Array, level: float, repeat: int, scene: str) -> Array:
    """Tracks (F, 2, P) with zero-mean Gaussian noise of standard deviation ``level * max|W|``; NaN stays NaN.

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
    noise = level * np.nanmax(np.abs(tracks)) * rng.standard_normal(tracks.shape)
    return np.asarray(tracks + noise)
