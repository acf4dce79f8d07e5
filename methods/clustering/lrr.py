"""Low-rank representation (Liu, Lin, Yan, Sun, Yu, Ma, PAMI 2013)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np
import scipy.linalg

from nrsfm.methods.base import Array, check_count, check_positive
from nrsfm.methods.clustering.clusterer import SubspaceClusterer, shape_interaction
from nrsfm.methods.numerics.admm import Admm
from nrsfm.methods.numerics.linear import TINY
from nrsfm.methods.numerics.proximal import singular_value_threshold


@dataclass(eq=False, repr=False)
class LRR(SubspaceClusterer):
    """Cluster points on a union of subspaces by their self-expression of least rank.

    Parameters
    ----------
    n_clusters : int or None
        None takes the number at the widest eigengap of the affinity.
    weight : float or None
        Lambda, the weight of the error |E|_2,1; None demands E = 0 (data without noise), in closed form. The authors
        take 4 for the raw tracks of Hopkins155.
    power : float
        Element-wise power of the affinity: 2 in the paper, 4 in the authors' code for motion.
    tol : float
        Stop when the primal and dual residuals, relative to the points, are below it; singular values below this share
        of the largest count as zero.
    seed : int
        Of k-means.

    Attributes
    ----------
    code_ : (n_samples, n_samples) array
        Z, with X = X Z + E for columns X.
    n_iter_ : int

    References
    ----------
    Liu, Lin, Yan, Sun, Yu, Ma, "Robust recovery of subspace structures by low-rank representation", PAMI 2013: eq. (7)
    and theorem 4.1 without noise, eq. (10) with it, section 5.2 for the affinity.
    """

    n_clusters: int | None = 2
    _: KW_ONLY
    weight: float | None = 0.5
    power: float = 2.0
    max_iter: int = 1000
    tol: float = 1e-6
    seed: int = 0

    def _check_settings(self) -> None:
        check_positive(self, "power", "tol")
        check_count(self, "max_iter")
        if self.weight is not None:
            check_positive(self, "weight")

    def _express(self, X: Array) -> Array:
        code, self.n_iter_ = low_rank_code(X, self.weight, self.max_iter, self.tol)
        return code

    def _affinity(self, n_clusters: int | None) -> Array:
        """Section 5.2: of the code's SVD, cut to its numerical rank."""
        U, s, _ = scipy.linalg.svd(self.code_, check_finite=False)
        kept = s > 1e-4 * max(s[0], TINY)
        return shape_interaction(U[:, kept], s[kept], self.power)


def low_rank_code(X: Array, weight: float | None, max_iter: int, tol: float) -> tuple[Array, int]:
    """min |Z|_* + weight |E|_2,1  s.t.  X = X Z + E, with |E|_2,1 the sum of the columns' lengths.

    With X = U diag(s) V' of rank r the solution without noise is Z = V V', the shape interaction matrix. With noise Z =
    V J, and E = U F has the columns' lengths of F, so that an (r, N) problem is left:

        min |K|_* + weight |F|_2,1  s.t.  K = J,  F = diag(s) (V' - J)

    by ADMM on two blocks, J and (K, F): J by one division for each row, K by a singular value threshold, F by a
    shrinkage of the columns. X is (D, N), one point a column; without a weight E = 0. Returns the (N, N) code and the
    number of iterations, 1 for the closed form.
    """
    _, s, Vt = scipy.linalg.svd(X, full_matrices=False, check_finite=False)
    kept = s > tol * max(s[0], TINY)
    s, Vt = s[kept, None], Vt[kept]
    if weight is None or not len(s):
        return Vt.T @ Vt, 1
    J, F = Vt.copy(), np.zeros_like(Vt)
    Y, M = np.zeros_like(Vt), np.zeros_like(Vt)  # scaled multipliers of K = J and of F = s (V' - J)
    size = max(float(np.linalg.norm(s)), float(np.sqrt(len(s))))
    admm = Admm(max_iter, tol)
    for b in admm:
        K, _ = singular_value_threshold(J - Y, 1 / b)
        rest = s * (Vt - J) - M
        F = rest * (1 - weight / b / np.maximum(np.linalg.norm(rest, axis=0), weight / b))
        before = J
        J = (K + Y + s * (s * Vt - F - M)) / (1 + s**2)
        Y += K - J
        M += F - s * (Vt - J)
        primal = float(np.hypot(np.linalg.norm(K - J), np.linalg.norm(F - s * (Vt - J)))) / size
        dual = b * float(np.hypot(np.linalg.norm(J - before), np.linalg.norm(s * (J - before)))) / (size * weight)
        factor = admm.balance(primal, dual)
        Y /= factor
        M /= factor
    return Vt.T @ K, admm.iteration
