"""Checked settings, signals and rotations, for every generated body."""

from __future__ import annotations

import numpy as np

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError, check_whole

VERSION = "v1"
FRAMES_PER_SECOND, SHORTEST_SECONDS = 30.0, 4.0
LARGEST = 10**8  # points times frames of one body: 2.4 GB


def check_settings(n_points: int, n_frames: int, seed: int) -> str:
    """The settings as they are written in a digest; DatasetError if one is out of range."""
    for key, value, least in (("points", n_points, 2), ("frames", n_frames, 2), ("seed", seed, 0)):
        check_whole(f"dataset.{key}", value, least)
    if n_frames * max(n_points, 300) > LARGEST:
        raise DatasetError(f"dataset.points x dataset.frames is {n_points} x {n_frames}, wanted at most {LARGEST:.0e}")
    return f"points={n_points}:frames={n_frames}:seed={seed}"


def signals(rng: np.random.Generator, n: int, n_frames: int) -> Array:
    """Quasi-periodic signals (F, n) within [-1, 1]: each a tempo, nearly its double, and a slow drift."""
    seconds = max((n_frames - 1) / FRAMES_PER_SECOND, SHORTEST_SECONDS)
    t = np.linspace(0, seconds, n_frames)[:, None, None]
    tempo = rng.uniform(0.25, 0.6, n)
    frequency = np.stack([tempo, tempo * rng.uniform(1.9, 2.1, n), tempo * rng.uniform(0.2, 0.5, n)])
    waves = np.sin(2 * np.pi * (frequency * t + rng.uniform(0, 1, (3, n))))
    return np.asarray(np.einsum("h,fhn->fn", [0.65, 0.2, 0.15], waves))


def rotations(v: Array) -> Array:
    """Rotations (..., 3, 3) of rotation vectors (..., 3), by Rodrigues' formula."""
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    K = np.cross(v[..., None, :], np.eye(3)).swapaxes(-1, -2)
    R: Array = np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (K @ K)
    return R
