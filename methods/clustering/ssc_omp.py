"""Sparse subspace clustering by orthogonal matching pursuit (You, Robinson, Vidal, CVPR 2016)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, ClusterMixin
from sklearn.utils.validation import validate_data

from nrsfm.methods.base import Array, check_setting
from nrsfm.methods.clustering.spectral import spectral_clustering

BLOCK = 512  # points that are coded at once


TINY = float(np.finfo(float).tiny)


class SSCOMP(ClusterMixin, BaseEstimator):
    """Cluster points on a union of subspaces by a greedy code of each in a few others.

    No array of n_samples x n_samples is made.

    Parameters
    ----------
    n_clusters : int or None
        None takes what the eigengap of the affinity says.
    n_nonzero : int
        k, the most points that express one; about the dimension of the subspaces.
    residual : float
        Epsilon: a point is expressed when what is left of it is below this share of its length.
    seed : int
        Of k-means.

    Attributes
    ----------
    code_ : (n_samples, n_samples) sparse array
        C, with X = X C for columns X of unit length; at most ``n_nonzero`` entries in a column.
    affinity_matrix_ : (n_samples, n_samples) sparse array
        |C| + |C'|.
    labels_ : (n_samples,) int array

    References
    ----------
    You, Robinson, Vidal, "Scalable sparse subspace clustering by orthogonal matching pursuit", CVPR 2016, algorithms 1
    and 2.
    """

    def __init__(
        self, n_clusters: int | None = 2, *, n_nonzero: int = 20, residual: float = 1e-6, seed: int = 0
    ) -> None:
        self.n_clusters = n_clusters
        self.n_nonzero = n_nonzero
        self.residual = residual
        self.seed = seed

    def fit(self, X: ArrayLike, y: Any = None) -> SSCOMP:
        """Cluster the rows of X, shape (n_samples, n_features)."""
        points: Array = validate_data(self, X, dtype=np.float64, ensure_min_samples=2)
        check_setting(self, "n_nonzero", 1, strict=False, whole=True)
        check_setting(self, "residual", 0, strict=False)
        self.code_ = matching_pursuit(points.T, self.n_nonzero, self.residual)
        self.affinity_matrix_ = abs(self.code_) + abs(self.code_).T
        self.labels_ = spectral_clustering(self.affinity_matrix_, self.n_clusters, seed=self.seed)
        return self

    def memory(self, n_samples: int, n_features: int) -> float:
        """Bytes that :meth:`fit` takes at its peak, foreseen from the sizes: the points, a block's bases and products,
        the sparse code and what the eigenvectors need.
        """
        block = min(BLOCK, n_samples)
        return 8.0 * (
            3 * n_samples * n_features
            + block * (3 * n_samples + (self.n_nonzero + 4) * n_features)
            + n_samples * (16 * self.n_nonzero + 100)
        )


def matching_pursuit(X: Array, n_nonzero: int, residual: float) -> sp.csc_array:
    """The code of each column of X in at most ``n_nonzero`` of the others, by orthogonal matching pursuit.

    Columns are scaled to unit length. For x, whose residual r starts as x: the column of the largest |x_i' r| joins the
    support, and r becomes what the support's span leaves of x, until |r| <= ``residual`` or the support is full. The
    span is kept as an orthonormal basis, grown by one vector a step (Gram and Schmidt, twice); a column that lies in it
    already ends the pursuit.

    Parameters
    ----------
    X : (D, N) array
        One point a column; a point at the origin has no code and expresses none.

    Returns
    -------
    (N, N) sparse array
        With zero diagonal.
    """
    X = X / np.maximum(np.linalg.norm(X, axis=0), TINY)
    N = X.shape[1]
    parts = [
        _pursue(X, np.arange(start, min(start + BLOCK, N)), min(n_nonzero, N - 1, len(X)), residual)
        for start in range(0, N, BLOCK)
    ]
    rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
    return sp.csc_array((values, (rows, columns)), shape=(N, N))


def _pursue(X: Array, mine: Array, most: int, residual: float) -> tuple[Array, Array, Array]:
    """Rows, columns and values of the code of the columns ``mine``, all of them at each step."""
    D, B = len(X), len(mine)
    basis = np.zeros((B, most, D))  # orthonormal, of each point's support
    support = np.zeros((B, most), dtype=np.int64)
    size = np.zeros(B, dtype=np.int64)
    r = X[:, mine].T.copy()
    active = np.flatnonzero(np.linalg.norm(r, axis=1) > max(residual, 1e-12))
    for step in range(most):
        products = np.abs(r[active] @ X)
        products[np.arange(len(active)), mine[active]] = -1
        np.put_along_axis(products, support[active, :step], -1, axis=1)
        chosen = products.argmax(axis=1)
        Q, new = basis[active, :step], X[:, chosen].T
        for _ in range(2):
            new = new - np.einsum("bkd,bk->bd", Q, np.einsum("bkd,bd->bk", Q, new))
        length = np.linalg.norm(new, axis=1)
        fresh = (length > 1e-10) & (products.max(axis=1) > 1e-12)
        active, new, chosen = active[fresh], new[fresh] / length[fresh, None], chosen[fresh]
        basis[active, step], support[active, step], size[active] = new, chosen, step + 1
        r[active] -= new * np.einsum("bd,bd->b", new, r[active])[:, None]
        active = active[np.linalg.norm(r[active], axis=1) > max(residual, 1e-12)]
        if not len(active):
            break
    rows = [support[b, :n] for b, n in enumerate(size)]
    values = [np.linalg.lstsq(X[:, own], X[:, j], rcond=None)[0] for own, j in zip(rows, mine, strict=True)]
    return np.concatenate(rows), np.repeat(mine, size), np.concatenate(values)
