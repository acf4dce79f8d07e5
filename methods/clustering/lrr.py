"""Low-rank representation (Liu, Lin, Yan, Sun, Yu, Ma, PAMI 2013)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, ClusterMixin
from sklearn.utils.validation import validate_data

from nrsfm.methods.base import Array, check_setting
from nrsfm.methods.clustering.spectral import spectral_clustering, unit_rows
from nrsfm.methods.numerics.proximal import singular_value_threshold


class LRR(ClusterMixin, BaseEstimator):
    """Cluster points on a union of subspaces by their self-expression of least rank.

    Parameters
    ----------
    n_clusters : int or None
        None takes what the eigengap of the affinity says.
    weight : float or None
        Lambda, the weight of what is not expressed, a whole point at a time; None expresses all (data without noise),
        in closed form. The authors take 4 for the tracks of Hopkins155 as they are.
    power : float
        Element-wise power of the affinity: 2 in the paper, 4 in the authors' code for motion.
    max_iter : int
    tol : float
        Stop when the primal and dual residuals are below it, relative to the points; singular values below this share
        of the largest count as zero.
    seed : int
        Of k-means.

    Attributes
    ----------
    code_ : (n_samples, n_samples) array
        Z, with X = X Z + E for columns X.
    affinity_matrix_ : (n_samples, n_samples) array
    labels_ : (n_samples,) int array
    n_iter_ : int

    References
    ----------
    Liu, Lin, Yan, Sun, Yu, Ma, "Robust recovery of subspace structures by low-rank representation", PAMI 2013: eq. (7)
    and theorem 4.1 without noise, eq. (10) with it, section 5.2 for the affinity.
    """

    def __init__(
        self,
        n_clusters: int | None = 2,
        *,
        weight: float | None = 0.5,
        power: float = 2.0,
        max_iter: int = 1000,
        tol: float = 1e-6,
        seed: int = 0,
    ) -> None:
        self.n_clusters = n_clusters
        self.weight = weight
        self.power = power
        self.max_iter = max_iter
        self.tol = tol
        self.seed = seed

    def fit(self, X: ArrayLike, y: Any = None) -> LRR:
        """Cluster the rows of X, shape (n_samples, n_features)."""
        points: Array = validate_data(self, X, dtype=np.float64, ensure_min_samples=2)
        for name in ("power", "tol"):
            check_setting(self, name, 0)
        check_setting(self, "max_iter", 1, strict=False, whole=True)
        if self.weight is not None:
            check_setting(self, "weight", 0)
        self.code_, self.n_iter_ = low_rank_code(points.T, self.weight, self.max_iter, self.tol)
        self.affinity_matrix_ = column_space_affinity(self.code_, self.power)
        self.labels_ = spectral_clustering(self.affinity_matrix_, self.n_clusters, seed=self.seed)
        return self


def low_rank_code(X: Array, weight: float | None, max_iter: int, tol: float) -> tuple[Array, int]:
    """min |Z|_* + weight |E|_2,1  s.t.  X = X Z + E, with |E|_2,1 the sum of the columns' lengths.

    With X = U diag(s) V' of rank r the solution without noise is Z = V V', the shape interaction matrix. With noise Z =
    V J, and E = U F has the columns' lengths of F, so that an (r, N) problem is left:

        min |K|_* + weight |F|_2,1  s.t.  K = J,  F = diag(s) (V' - J)

    by ADMM on two blocks, J and (K, F): J by one division for each row, K by a singular value threshold, F by a
    shrinkage of the columns.

    Parameters
    ----------
    X : (D, N) array
        One point a column.
    weight : float or None
        None demands E = 0.

    Returns
    -------
    (N, N) array, int
        The code and the number of iterations, 1 for the closed form.
    """
    _, s, Vt = scipy.linalg.svd(X, full_matrices=False, check_finite=False)
    kept = s > tol * max(s[0], float(np.finfo(float).tiny))
    s, Vt = s[kept, None], Vt[kept]
    if weight is None or not len(s):
        return Vt.T @ Vt, 1
    J, F = Vt.copy(), np.zeros_like(Vt)
    Y, M = np.zeros_like(Vt), np.zeros_like(Vt)  # scaled multipliers of K = J and of F = s (V' - J)
    b = 1.0
    size = max(float(np.linalg.norm(s)), float(np.sqrt(len(s))))
    iteration = 0
    while iteration < max_iter:
        iteration += 1
        K, _ = singular_value_threshold(J - Y, 1 / b)
        rest = s * (Vt - J) - M
        F = rest * (1 - weight / b / np.maximum(np.linalg.norm(rest, axis=0), weight / b))
        before = J
        J = (K + Y + s * (s * Vt - F - M)) / (1 + s**2)
        Y += K - J
        M += F - s * (Vt - J)
        primal = float(np.hypot(np.linalg.norm(K - J), np.linalg.norm(F - s * (Vt - J)))) / size
        dual = b * float(np.hypot(np.linalg.norm(J - before), np.linalg.norm(s * (J - before)))) / (size * weight)
        if max(primal, dual) < tol:
            break
        if iteration % 10 == 0 and iteration < max_iter // 2:
            factor = 2.0 if primal > 5 * dual else 0.5 if dual > 5 * primal else 1.0
            b *= factor
            Y /= factor
            M /= factor
    return Vt.T @ K, iteration


def column_space_affinity(Z: Array, power: float) -> Array:
    """|M M'|^power, section 5.2: M holds the rows of U sqrt(D) at unit length, Z = U D V' of numerical rank."""
    U, s, _ = scipy.linalg.svd(Z, check_finite=False)
    kept = s > 1e-4 * max(s[0], float(np.finfo(float).tiny))
    M = unit_rows(U[:, kept] * np.sqrt(s[kept]))
    return np.abs(M @ M.T) ** power
