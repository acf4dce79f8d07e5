"""The axes of a frame's camera: two image rows and the viewing direction."""

from __future__ import annotations

import numpy as np

from nrsfm.methods.base import Array


def axes(cameras: Array) -> Array:
    """Complete (F, 2, 3) cameras to rotations Q_f = [r1; r2; r1 x r2], shape (F, 3, 3).

    In these axes R'R of W = R S (Kumar, Dai, Li, 3DV 2016, eq. 1) is diag(1, 1, 0): image rows and depth rows decouple.
    """
    across = np.cross(cameras[:, 0, :], cameras[:, 1, :])
    return np.concatenate([cameras, across[:, None]], axis=1)
