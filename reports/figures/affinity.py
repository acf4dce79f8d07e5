"""An affinity as a picture: normalised as for clustering, its tracks sorted by body, at most so large."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

CELLS = 400
"""The most rows of a picture."""


def picture(affinity: Any, truth: NDArray[Any] | None) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """D^-1/2 A D^-1/2 as in spectral clustering, its largest 2 % clipped; sums over cells where it is large.

    Tracks are sorted by ``truth`` (P,), the bodies.

    Returns
    -------
    (N, N) array, (K,) array
        The picture, N = min(P, :data:`CELLS`), and the rows where each body but the first begins.
    """
    n = affinity.shape[0]
    order = np.argsort(truth, kind="stable") if truth is not None else np.arange(n)
    degrees = np.asarray(affinity.sum(axis=1), float).ravel()
    weights = np.divide(1, np.sqrt(degrees), out=np.zeros(n), where=degrees > 0)
    if sp.issparse(affinity) or n > CELLS:
        A = binned(sp.diags_array(weights) @ sp.csr_array(affinity) @ sp.diags_array(weights), order)
    else:
        A = (weights[:, None] * np.asarray(affinity, float) * weights)[np.ix_(order, order)]
    top = np.quantile(A[A > 0], 0.98) if (A > 0).any() else 1.0
    edges = np.flatnonzero(np.diff(truth[order])) + 1 if truth is not None else np.empty(0, np.int64)
    return np.clip(A, 0, top), edges * len(A) // n


def binned(affinity: sp.sparray, order: NDArray[Any]) -> NDArray[Any]:
    """Sums of a sparse affinity, its tracks in the given order, over the cells of a grid of at most CELLS rows."""
    n, pairs = affinity.shape[0], sp.coo_array(affinity)
    cells = min(n, CELLS)
    place = np.empty(n, dtype=np.int64)
    place[order] = np.arange(n) * cells // n
    image = np.bincount(place[pairs.row] * cells + place[pairs.col], pairs.data, cells**2)
    return image.reshape(cells, cells)
