"""Sparse subspace clustering by orthogonal matching pursuit (You, Robinson, Vidal, CVPR 2016)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from nrsfm.methods.base import Array, Labels, check_at_least, check_count
from nrsfm.methods.clustering.clusterer import SubspaceClusterer
from nrsfm.methods.numerics.linear import TINY

BLOCK = 512  # points that are coded at once


@dataclass(eq=False, repr=False)
class SSCOMP(SubspaceClusterer):
    """Cluster points on a union of subspaces by a greedy code of each in a few others.

    No array of n_samples x n_samples is made.

    Parameters
    ----------
    n_clusters : int or None
        None takes the number at the widest eigengap of the affinity.
    n_nonzero : int
        k, the most points in the code of one; about the dimension of the subspaces.
    residual : float
        Epsilon: the pursuit of a point ends when its residual is below this share of its length. The authors' program
        compares the squared share with 1e-6.
    seed : int
        Of k-means.

    Attributes
    ----------
    code_ : (n_samples, n_samples) sparse array
        C, with X = X C for columns X of unit length; at most ``n_nonzero`` entries in a column.
    affinity_matrix_ : (n_samples, n_samples) sparse array
        |C| + |C'|.

    References
    ----------
    You, Robinson, Vidal, "Scalable sparse subspace clustering by orthogonal matching pursuit", CVPR 2016, algorithms 1
    and 2.
    """

    n_clusters: int | None = 2
    _: KW_ONLY
    n_nonzero: int = 20
    residual: float = 1e-3
    seed: int = 0

    def _check_settings(self) -> None:
        check_count(self, "n_nonzero")
        check_at_least(self, 0, "residual")

    def _express(self, X: Array) -> sp.csc_array:
        return matching_pursuit(X, self.n_nonzero, self.residual)

    def _affinity(self, n_clusters: int | None) -> sp.sparray:
        return abs(self.code_) + abs(self.code_).T

    def memory(self, n_samples: int, n_features: int) -> float:
        """Peak memory of :meth:`fit` in bytes: points, a block's bases and products, the sparse code, eigenvectors."""
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
    already ends the pursuit. X is (D, N), one point a column; a point at the origin has no code and expresses none. The
    (N, N) code has a zero diagonal.
    """
    X = X / np.maximum(np.linalg.norm(X, axis=0), TINY)
    N = X.shape[1]
    parts = [
        _pursue(X, np.arange(start, min(start + BLOCK, N)), min(n_nonzero, N - 1, len(X)), residual)
        for start in range(0, N, BLOCK)
    ]
    rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
    return sp.csc_array((values, (rows, columns)), shape=(N, N))


def _pursue(X: Array, mine: NDArray[np.int64], most: int, residual: float) -> tuple[Labels, Labels, Array]:
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
    values = [np.linalg.lstsq(X[:, others], X[:, j], rcond=None)[0] for others, j in zip(rows, mine, strict=True)]
    return np.concatenate(rows), np.repeat(mine, size), np.concatenate(values)
