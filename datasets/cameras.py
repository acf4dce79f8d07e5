"""Orthographic cameras."""

from __future__ import annotations

import numpy as np

from nrsfm.datasets.body import Array


def orbit(n_frames: int, degrees_per_frame: float = 5.0) -> Array:
    """Cameras that circle the vertical z axis, one a frame, with a vertical image y axis.

    Returns
    -------
    (n_frames, 2, 3) array
        Rows ``[cos a, sin a, 0]`` and ``[0, 0, 1]`` with ``a = degrees_per_frame * frame``; orthonormal.
    """
    a = np.deg2rad(degrees_per_frame) * np.arange(n_frames)
    R = np.zeros((n_frames, 2, 3))
    R[:, 0, 0] = np.cos(a)
    R[:, 0, 1] = np.sin(a)
    R[:, 1, 2] = 1.0
    return R


def project(cameras: Array, structure: Array) -> Array:
    """Tracks W = R S, (F, 2, P), of (F, 2, 3) cameras R and (F, 3, P) structure S."""
    return cameras @ structure
