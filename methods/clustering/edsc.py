"""Efficient dense subspace clustering (Ji, Salzmann, Li, WACV 2014)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np
import scipy.linalg

from nrsfm.methods.base import Array, check_count, check_positive
from nrsfm.methods.clustering.clusterer import SubspaceClusterer, shape_interaction
from nrsfm.methods.clustering.spectral import MOST, eigengaps


@dataclass(eq=False, repr=False)
class EDSC(SubspaceClusterer):
    """Cluster points on a union of (affine) subspaces by their least-squares self-expression, in closed form.

    Parameters
    ----------
    n_clusters : int or None
        None takes the number n with the widest eigengap at n of the affinity for n clusters.
    weight : float
        Lambda, the weight of the data term: 120 for rigid motion in the authors' experiments.
    affine : bool
        Demand that each column of the code sums to one.
    dimension : int
        Assumed dimension of each subspace: rank ``dimension * n_clusters + 1`` of the code is kept. 4 for rigid motion.
    power : float
        Element-wise power of the affinity.
    seed : int
        Of k-means.
    cut : {"means", "cheapest", "rotation"}
        See :func:`nrsfm.methods.clustering.spectral.spectral_clustering`. The authors' program takes ``rotation``.

    References
    ----------
    Ji, Salzmann, Li, "Efficient dense subspace clustering", WACV 2014, eqs. (6) and (16), section 4.
    """

    n_clusters: int | None = 2
    _: KW_ONLY
    weight: float = 120.0
    affine: bool = True
    dimension: int = 4
    power: float = 4.0
    seed: int = 0
    cut: str = "means"

    def _check_settings(self) -> None:
        check_positive(self, "weight", "power")
        check_count(self, "dimension")

    def _express(self, X: Array) -> Array:
        return dense_code(X, self.weight, self.affine)

    def _affinity(self, n_clusters: int | None) -> Array:
        """Section 4: of the symmetrised code's SVD, cut to rank ``dimension * n_clusters + 1``."""
        U, s, _ = scipy.linalg.svd((self.code_ + self.code_.T) / 2, check_finite=False)
        rank = self.dimension * (n_clusters or 1) + 1
        return shape_interaction(U[:, :rank], s[:rank], self.power)

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
        C: Array = scipy.linalg.solve(np.eye(n) + G, G, assume_a="pos", check_finite=False)
        return C
    V = scipy.linalg.null_space(np.ones((1, n)))
    inverse: Array = scipy.linalg.solve(V.T @ V + V.T @ G @ V, V.T, assume_a="pos", check_finite=False)
    correction: Array = V @ inverse
    return np.eye(n) - correction
