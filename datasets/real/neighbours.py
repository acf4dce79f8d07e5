"""Neighbours among the points of a dense body or image, and an even choice of few among many."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import check_whole

Edges = NDArray[np.int64]


def pixel_edges(pixels: NDArray[np.int64]) -> Edges:
    """Pairs of points on pixels that share a side, each pair once.

    Parameters
    ----------
    pixels : (P, 2) int array
        No two alike.

    Returns
    -------
    (E, 2) int array
    """
    low = pixels - pixels.min(axis=0)
    wide = int(low[:, 1].max()) + 2  # a gap between the rows' ends
    place = low[:, 0] * wide + low[:, 1]
    order = np.argsort(place)
    pairs = []
    for step in (1, wide):
        at = np.minimum(np.searchsorted(place[order], place + step), len(place) - 1)
        filled = place[order][at] == place + step
        pairs.append(np.column_stack([np.flatnonzero(filled), order[at[filled]]]))
    return np.concatenate(pairs)


def on_pixels(image: Array) -> NDArray[np.int64] | None:
    """The pixels (P, 2) of (2, P) image positions; None unless they are whole numbers and no two alike."""
    whole = np.rint(image)
    if np.abs(image - whole).max() > 1e-6 or np.abs(whole).max() > 2**30:
        return None
    pixels = whole.T.astype(np.int64)
    return pixels if len(np.unique(pixels, axis=0)) == len(pixels) else None


def nearest_edges(points: Array, k: int = 4) -> Edges:
    """Pairs (E, 2) of each of (d, P) points and its ``k`` nearest others, each pair once."""
    P = points.shape[1]
    k = min(k, P - 1)
    near = KDTree(points.T).query(points.T, k + 1)[1]
    first = np.repeat(np.arange(P), k + 1)
    pairs = np.sort(np.column_stack([first, near.ravel()]), axis=1)
    return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)


def even_choice(points: Array, n: int | None) -> NDArray[np.int64]:
    """Ascending indices of ``n`` of (2, P) points that cover the image evenly; None chooses all.

    The points are sorted along the Z-order curve, which fills one neighbourhood after the other, and taken in equal
    steps.

    Raises
    ------
    DatasetError
        If ``n`` is not a whole number from 2 to P.
    """
    P = points.shape[1]
    if n is None:
        return np.arange(P)
    check_whole("dataset.points", n, 2, P, ", or null for all")
    span = np.ptp(points, axis=1).max() or 1.0
    cell = ((points - points.min(axis=1, keepdims=True)) / span * (2**16 - 1)).astype(np.uint64)
    code = _spread_bits(cell[0]) | (_spread_bits(cell[1]) << np.uint64(1))
    walk = np.argsort(code, kind="stable")
    return np.sort(walk[((np.arange(n) + 0.5) * P / n).astype(np.int64)])


def _spread_bits(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The lowest sixteen bits of each number, with a zero bit between each two."""
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        x = (x | (x << np.uint64(shift))) & np.uint64(mask)
    return x
