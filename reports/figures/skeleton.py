"""Edges between points of a body that keep their distance, so that people look like people."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import minimum_spanning_tree

MOST = 400
"""Bodies of more points are drawn as points: they are surfaces, and a tree says nothing about them."""


def stable_edges(structure: NDArray[np.floating], labels: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
    """A spanning tree of each body, of pairs whose distance changes least and is short.

    The length of a pair is the standard deviation of its distance over the frames, plus a tenth of the mean distance.
    Bones of one length have no deviation: there the nearer pair counts.

    Parameters
    ----------
    structure : (F, 3, P) array
    labels : (P,) array, optional
        The body of each point; one body without.

    Returns
    -------
    (E, 2) array of int
        Places of points. Bodies of one point, or of more than :data:`MOST`, have none.
    """
    bodies = np.zeros(structure.shape[2], dtype=np.int64) if labels is None else labels
    edges = [np.empty((0, 2), dtype=np.int64)]
    for body in np.unique(bodies):
        (points,) = np.nonzero(bodies == body)
        if 1 < len(points) <= MOST:
            edges.append(points[_tree(structure[:, :, points])])
    return np.concatenate(edges)


def _tree(X: NDArray[np.floating]) -> NDArray[np.int64]:
    """Pairs (E, 2) of the minimum spanning tree of (F, 3, P) points."""
    total, squares = np.zeros((2, X.shape[2], X.shape[2]))
    for points in X:
        gram = points.T @ points
        square = np.maximum(np.diag(gram)[:, None] + np.diag(gram) - 2 * gram, 0)
        total += np.sqrt(square)
        squares += square
    mean = total / len(X)
    deviation = np.sqrt(np.maximum(squares / len(X) - mean**2, 0))
    cost = deviation + 0.1 * mean + np.finfo(float).tiny  # the tree takes 0 for "no edge"
    tree = minimum_spanning_tree(np.triu(cost, 1)).tocoo()
    return np.sort(np.stack([tree.row, tree.col], axis=1).astype(np.int64), axis=1)
