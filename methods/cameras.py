"""The frame's own axes: two image rows and the viewing direction."""

from __future__ import annotations

import numpy as np

from methods.base import Array


def axes(cameras: Array) -> Array:
    """Complete (F, 2, 3) cameras to rotations Q_f = [r1; r2; r1 x r2], shape (F, 3, 3).

    In these axes R'R of W = R S (Kumar, Dai, Li, 3DV 2016, eq. 1) is diag(1, 1, 0): image rows and depth rows decouple.
    """
    return np.concatenate([cameras, np.cross(cameras[:, 0], cameras[:, 1])[:, None]], axis=1)
