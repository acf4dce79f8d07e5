"""What the subspace clusterers share: a self-expressive code, an affinity from it, and spectral clustering."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Self, TypeAlias

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, ClusterMixin
from sklearn.utils.validation import validate_data

from nrsfm.methods.base import Array, Labels, check_word
from nrsfm.methods.clustering.spectral import CUTS, spectral_clustering
from nrsfm.methods.numerics.linear import unit_rows

Code: TypeAlias = Array | sp.sparray


class SubspaceClusterer(ClusterMixin, BaseEstimator):  # type: ignore[misc]
    """Cluster points by an affinity that comes from their code, which expresses each point by the others.

    A subclass has the hyper-parameters ``n_clusters``, ``seed`` and perhaps ``cut``, and the steps of :meth:`fit`.

    Attributes
    ----------
    code_ : (n_samples, n_samples) array or sparse array
        C, with X = X C for columns X, up to what the method leaves out.
    affinity_matrix_ : (n_samples, n_samples) array or sparse array
    labels_ : (n_samples,) int array
    """

    n_clusters: int | None
    seed: int
    cut: str = "means"  #: of :data:`nrsfm.methods.clustering.spectral.CUTS`
    code_: Any
    affinity_matrix_: Any
    labels_: Labels

    def fit(self, X: ArrayLike, y: object = None) -> Self:
        """Cluster the rows of X, shape (n_samples, n_features)."""
        points: Array = validate_data(self, X, dtype=np.float64, ensure_min_samples=2)
        check_word(self, "cut", CUTS)
        self._check_settings()
        self.code_ = self._express(points.T)
        n_clusters = self._count() if self.n_clusters is None else self.n_clusters
        self.affinity_matrix_ = self._affinity(n_clusters)
        self.labels_ = spectral_clustering(self.affinity_matrix_, n_clusters, seed=self.seed, cut=self.cut)
        return self

    @abstractmethod
    def _check_settings(self) -> None:
        """Raise MethodError if a hyper-parameter is wrong."""

    @abstractmethod
    def _express(self, X: Array) -> Code:
        """The code of (D, N) points, one a column."""

    @abstractmethod
    def _affinity(self, n_clusters: int | None) -> Code:
        """The affinity of ``code_``."""

    def _count(self) -> int | None:
        """The number of clusters where it is not given; None takes the widest eigengap of the affinity."""
        return None


def shape_interaction(U: Array, s: Array, power: float) -> Array:
    """|M M'|^power, where M holds the rows of U diag(sqrt(s)) at unit length.

    U and s are the leading left singular vectors and values of a code: the cosines between rows in its column space.
    """
    M = unit_rows(U * np.sqrt(s))
    return np.abs(M @ M.T) ** power
