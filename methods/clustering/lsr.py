"""Least squares regression (Lu, Min, Zhao, Zhu, Huang, Yan, ECCV 2012)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np
import scipy.linalg

from nrsfm.methods.base import Array, check_positive
from nrsfm.methods.clustering.clusterer import SubspaceClusterer
from nrsfm.methods.numerics.linear import without_diagonal


@dataclass(eq=False, repr=False)
class LSR(SubspaceClusterer):
    """Cluster points on a union of subspaces by their ridge regression on each other, in closed form.

    Parameters
    ----------
    n_clusters : int or None
        None takes the number at the widest eigengap of the affinity.
    weight : float
        Lambda, the weight of |Z|^2 against |X - X Z|^2; in the unit of the points, squared.
    seed : int
        Of k-means.
    cut : {"means", "cheapest", "rotation"}
        See :func:`nrsfm.methods.clustering.spectral.spectral_clustering`.

    Attributes
    ----------
    code_ : (n_samples, n_samples) array
        Z, with X about X Z for columns X, and a zero diagonal.
    affinity_matrix_ : (n_samples, n_samples) array
        |Z| + |Z'|.

    References
    ----------
    Lu et al., "Robust and efficient subspace segmentation via least squares regression", ECCV 2012, eq. (7) (LSR1).
    """

    n_clusters: int | None = 2
    _: KW_ONLY
    weight: float = 0.05
    seed: int = 0
    cut: str = "means"

    def _check_settings(self) -> None:
        check_positive(self, "weight")

    def _express(self, X: Array) -> Array:
        return ridge_code(X, self.weight)

    def _affinity(self, n_clusters: int | None) -> Array:
        affinity: Array = np.abs(self.code_) + np.abs(self.code_.T)
        return affinity


def ridge_code(X: Array, weight: float) -> Array:
    """min |X - X Z|^2 + weight |Z|^2 with a zero diagonal; (D, N) points to an (N, N) code.

    With D = (X'X + weight I)^-1 it is Z_ij = -D_ij / D_jj.
    """
    D = scipy.linalg.inv(X.T @ X + weight * np.eye(X.shape[1]), check_finite=False)
    return without_diagonal(-D / np.diag(D))
