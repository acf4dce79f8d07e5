"""Efficient dense subspace clustering (Ji, Salzmann, Li, WACV 2014)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, ClusterMixin
from sklearn.utils.validation import validate_data

from nrsfm.methods.base import Array, check_setting
from nrsfm.methods.clustering.spectral import MOST, eigengaps, spectral_clustering


class EDSC(ClusterMixin, BaseEstimator):
    """Cluster points on a union of (affine) subspaces by their least-squares self-expression, in closed form.

    Parameters
    ----------
    n_clusters : int or None
        None takes the number whose own affinity, of rank ``dimension * n_clusters + 1``, has the widest eigengap there.
    weight : float
        Lambda, the weight of the data term.
    affine : bool
        Demand that each column of the code sums to one.
    dimension : int
        Assumed dimension of each subspace: rank ``dimension * n_clusters + 1`` of the code is kept.
    power : float
        Element-wise power of the affinity.
    seed : int
        Of k-means.

    Attributes
    ----------
    code_ : (n_samples, n_samples) array
    affinity_matrix_ : (n_samples, n_samples) array
    labels_ : (n_samples,) int array

    References
    ----------
    Ji, Salzmann, Li, "Efficient dense subspace clustering", WACV 2014, eqs. (6) and (16), section 4.
    """

    def __init__(
        self,
        n_clusters: int | None = 2,
        *,
        weight: float = 120.0,
        affine: bool = True,
        dimension: int = 4,
        power: float = 4.0,
        seed: int = 0,
    ) -> None:
        self.n_clusters = n_clusters
        self.weight = weight
        self.affine = affine
        self.dimension = dimension
        self.power = power
        self.seed = seed

    def fit(self, X: ArrayLike, y: Any = None) -> EDSC:
        """Cluster the rows of X, shape (n_samples, n_features)."""
        points: Array = validate_data(self, X, dtype=np.float64, ensure_min_samples=2)
        check_setting(self, "weight", 0)
        check_setting(self, "power", 0)
        check_setting(self, "dimension", 1, strict=False, whole=True)
        self.code_ = dense_code(points.T, self.weight, self.affine)
        n = self._count() if self.n_clusters is None else self.n_clusters
        self.affinity_matrix_ = self._affinity(n)
        self.labels_ = spectral_clustering(self.affinity_matrix_, n, seed=self.seed)
        return self

    def _affinity(self, n_clusters: int) -> Array:
        rank = min(self.dimension * n_clusters + 1, len(self.code_))
        return shape_interaction(self.code_, rank, self.power)

    def _count(self) -> int:
        gaps = [eigengaps(self._affinity(n))[n - 1] for n in range(1, min(MOST, len(self.code_) - 1) + 1)]
        return int(np.argmax(gaps)) + 1


def dense_code(X: Array, weight: float, affine: bool) -> Array:
    """min 1/2 |C|^2 + weight/2 |X - X C|^2, and 1'C = 1' when affine; (D, N) points to an (N, N) code.

    The linear solution is C = (I + weight X'X)^-1 weight X'X, eq. (6); the affine one, eq. (16), is
    C = I - V (V'V + V' weight X'X V)^-1 V' with V spanning the null space of 1'.
    """
    n = X.shape[1]
    G = weight * (X.T @ X)
    if not affine:
        return scipy.linalg.solve(np.eye(n) + G, G, assume_a="pos", check_finite=False)
    V = scipy.linalg.null_space(np.ones((1, n)))
    return np.eye(n) - V @ scipy.linalg.solve(V.T @ V + V.T @ G @ V, V.T, assume_a="pos", check_finite=False)


def shape_interaction(C: Array, rank: int, power: float) -> Array:
    """Affinity |M M'|^power, section 4: M holds the rows of U sqrt(D) at unit length, U D V' the symmetrised code's SVD
    cut to a rank.
    """
    U, s, _ = scipy.linalg.svd((C + C.T) / 2, check_finite=False)
    M = U[:, :rank] * np.sqrt(s[:rank])
    M /= np.maximum(np.linalg.norm(M, axis=1, keepdims=True), np.finfo(float).tiny)
    return np.abs(M @ M.T) ** power
