"""Cuts of a graph along one eigenvector at a time, for graphs whose smallest cut k-means on the eigenvectors misses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from nrsfm.methods.base import Array, Labels

Second = Callable[[sp.csr_array], Array]


def normalised_cut(A: sp.csr_array, labels: Labels, n_clusters: int) -> float:
    """Sum over the clusters of (weight of edges that leave it / weight of its points), from 0 to ``n_clusters``.

    A cluster that is empty, or whose points have no edge, counts 1, the most that a cluster can.
    Shi and Malik, "Normalized cuts and image segmentation", PAMI 2000, section 2.1, for any number of clusters.
    """
    graph = sp.coo_array(A)
    rows, columns = graph.coords
    volume = np.bincount(labels[rows], graph.data, n_clusters)
    crossing = labels[rows] != labels[columns]
    leaving = np.bincount(labels[rows[crossing]], graph.data[crossing], n_clusters)
    return float(np.divide(leaving, volume, out=np.ones(n_clusters), where=volume > 0).sum())


def recursive_cut(A: sp.csr_array, n_clusters: int, vector: Array, second: Second) -> Labels:
    """Clusters by repeated splits: each time the one split that leaves the smallest normalised cut.

    The split of a cluster is the best of all its prefixes in the order of the second eigenvector (Shi and Malik, PAMI
    2000, section 3). Each is an eigenvector and a sort: O(entries) a step of the eigensolver.

    A (P, P) is symmetric and non-negative, its diagonal zero. ``vector`` is the second leading eigenvector of
    D^-1/2 A D^-1/2, and ``second`` computes that of a part of the graph. The (P,) labels start from 0; one may be empty
    where nothing is left to split.
    """
    labels = np.zeros(A.shape[0], dtype=np.int64)
    sides = {0: _cheapest_prefix(A, vector)}
    for new in range(1, n_clusters):
        for k in set(range(new)) - set(sides):
            inside = np.flatnonzero(labels == k)
            part = sp.csr_array(A[inside][:, inside])
            sides[k] = inside[_cheapest_prefix(part, second(part))] if part.nnz else inside[:0]
        candidates = {}
        for k, side in sides.items():
            candidates[k] = labels.copy()
            candidates[k][side] = new
        best = min(candidates, key=lambda k: normalised_cut(A, candidates[k], new + 1))
        labels = candidates[best]
        del sides[best]
    return labels


def _cheapest_prefix(A: sp.csr_array, vector: Array) -> NDArray[np.int64]:
    """The prefix of least cut, of the points in the order of an eigenvector of D^-1/2 A D^-1/2."""
    degree = np.asarray(A.sum(axis=1)).ravel()
    order = np.argsort(vector / np.sqrt(np.maximum(degree, np.finfo(float).tiny ** 0.5)), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    edges = sp.coo_array(sp.triu(A, 1))
    first, last = np.sort(rank[np.stack(edges.coords)], axis=0)
    steps = np.bincount(first, edges.data, len(order)) - np.bincount(last, edges.data, len(order))
    cut, volume = np.cumsum(steps)[:-1], np.cumsum(degree[order])[:-1]
    both = volume * (degree.sum() - volume)
    cost = np.divide(cut * degree.sum(), both, out=np.full(len(cut), np.inf), where=both > 0)
    return order[: int(np.argmin(cost)) + 1]
