"""Dropped observations, reproducible from the scene that they are dropped from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError, check_whole, is_number
from nrsfm.datasets.noise import seed

KINDS = ("none", "random", "stretches")


def drop(tracks: Array, kind: str, share: float, length: int, repeat: int, scene: str) -> NDArray[np.bool_]:
    """Which positions of (F, 2, P) tracks stay visible when a share of the observed ones is dropped.

    ``random`` drops single positions. ``stretches`` drops ``length`` frames of a track at a time, as if something
    passed in front of it. Every frame keeps two points and every track two frames. A draw depends on the scene's name,
    kind, share and repeat; it is the same for every method.

    Returns
    -------
    (F, P) bool array

    Raises
    ------
    DatasetError
        If a setting is out of range, or the share is more than can be dropped.
    """
    if kind not in KINDS:
        raise DatasetError(f"gaps.kind is {kind!r}, wanted one of {', '.join(KINDS)}")
    if not is_number(share) or not 0 <= share < 1:
        raise DatasetError(f"gaps.share is {share!r}, wanted a number from 0 to less than 1")
    check_whole("gaps.length", length, 1, remark=" (frames)")
    visible: NDArray[np.bool_] = np.isfinite(tracks[:, 0])
    if kind == "none" or share == 0:
        return visible
    wanted = round(share * int(visible.sum()))
    rng = np.random.default_rng(seed(f"{scene}|{kind}", share, repeat))
    order = rng.permutation(np.argwhere(visible)) if kind == "random" else _stretches(rng, visible, length)
    frames, points = visible.sum(axis=1), visible.sum(axis=0)
    for f, p in order:
        if wanted == 0:
            break
        if visible[f, p] and frames[f] > 2 and points[p] > 2:
            visible[f, p] = False
            frames[f] -= 1
            points[p] -= 1
            wanted -= 1
    if wanted:
        raise DatasetError(f"gaps.share is {share}, more than can be dropped from scene {scene}")
    return visible


def _stretches(rng: np.random.Generator, visible: NDArray[np.bool_], length: int) -> NDArray[np.int64]:
    """Every position once, in random order of stretches; each track is cut into stretches at random borders."""
    F, P = visible.shape
    pieces = []
    for p in range(P):
        borders = np.arange(rng.integers(length) - length, F, length)
        pieces += [(max(0, start), min(F, start + length), p) for start in borders if start + length > 0]
    chosen = [pieces[k] for k in rng.permutation(len(pieces))]
    return np.array([(f, p) for start, end, p in chosen for f in range(start, end)])
