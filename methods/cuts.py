"""Cuts of a graph along one eigenvector at a time, where k-means on the eigenvectors loses the cheapest cut."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from methods.base import Array, Labels, Mask

#: The second leading eigenvector of D^-1/2 A D^-1/2 of a sparse graph.
Second = Callable[[sp.csr_array], Array]


def normalised_cut(A: sp.csr_array, labels: Labels) -> float:
    """Sum over clusters of the weight that leaves it over the weight of its points; 0 where nothing is joined.

    Shi and Malik, "Normalized cuts and image segmentation", PAMI 2000, section 2.1, for any number of clusters.
    """
    degree = np.asarray(A.sum(axis=1)).ravel()
    rows, columns = sp.coo_array(A).coords
    crossing = labels[rows] != labels[columns]
    left = np.bincount(labels[rows[crossing]], sp.coo_array(A).data[crossing], labels.max() + 1)
    volume = np.bincount(labels, degree)
    return float(np.sum(left[volume > 0] / volume[volume > 0]))


def recursive_cut(A: sp.csr_array, n_clusters: int, second: Second) -> Labels:
    """Clusters by splitting, again and again, the cluster whose cheapest split leaves the cheapest normalised cut.

    The split of a cluster is the best of all its prefixes in the order of the second eigenvector (Shi and Malik, PAMI
    2000, section 3). Each is an eigenvector and a sort: O(entries) a step of the eigensolver.

    Parameters
    ----------
    A : (P, P) sparse array
        Symmetric, non-negative, its diagonal zero.
    n_clusters : int
    second : callable
        Gives the second leading eigenvector of D^-1/2 A D^-1/2.

    Returns
    -------
    (P,) int array
        Labels from 0; fewer than ``n_clusters`` where nothing is left to split.
    """
    labels = np.zeros(A.shape[0], dtype=np.int64)
    sides: dict[int, Mask] = {}
    for new in range(1, n_clusters):
        sides |= {k: _split(A, labels == k, second) for k in range(new) if k not in sides}
        tried = {k: np.where(side, new, labels) for k, side in sides.items() if side.any()}
        if not tried:
            break
        best = min(tried, key=lambda k: normalised_cut(A, tried[k]))
        labels = tried[best]
        del sides[best]
    return labels


def _split(A: sp.csr_array, inside: Mask, second: Second) -> Mask:
    """The points of a cluster that its cheapest prefix takes away, (P,) bool; none where it cannot be split."""
    side = np.zeros(len(inside), dtype=bool)
    places = np.flatnonzero(inside)
    part = sp.csr_array(A[places][:, places])
    degree = np.asarray(part.sum(axis=1)).ravel()
    if len(places) < 3 or not degree.any():
        return side
    order = np.argsort(second(part) / np.sqrt(np.maximum(degree, np.finfo(float).tiny ** 0.5)), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    whole = sp.coo_array(sp.triu(part, 1))
    ends = np.sort(rank[np.stack(whole.coords)], axis=0)
    steps = np.bincount(ends[0], whole.data, len(order)) - np.bincount(ends[1], whole.data, len(order))
    cut, volume = np.cumsum(steps)[:-1], np.cumsum(degree[order])[:-1]
    rest = degree.sum() - volume
    able = (volume > 0) & (rest > 0)
    cost = np.where(able, cut / np.where(able, volume, 1) + cut / np.where(able, rest, 1), np.inf)
    side[places[order[: int(np.argmin(cost)) + 1]]] = True
    return side
