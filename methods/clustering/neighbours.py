"""Plain spectral clustering of nearest neighbours, without a subspace: what the other clusterers have to beat."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import scipy.sparse as sp

from nrsfm.methods.base import Array, check_count
from nrsfm.methods.clustering.clusterer import SubspaceClusterer


@dataclass(eq=False, repr=False)
class Neighbours(SubspaceClusterer):
    """Cluster points by the graph of their nearest neighbours, as scikit-learn's ``SpectralClustering`` does.

    Parameters
    ----------
    n_clusters : int or None
        None takes the number at the widest eigengap of the affinity.
    n_neighbours : int
        k: each point is joined to itself and the k - 1 nearest; all points where there are fewer.
    seed : int
        Of k-means.
    cut : {"means", "cheapest", "rotation"}
        See :func:`nrsfm.methods.clustering.spectral.spectral_clustering`.

    Attributes
    ----------
    code_ : (n_samples, n_samples) sparse array
        1 at (i, j) where j is a neighbour of i.
    affinity_matrix_ : (n_samples, n_samples) sparse array
        Its mean with its transpose.

    References
    ----------
    von Luxburg, "A tutorial on spectral clustering", Statistics and Computing 2007, section 2.2.
    """

    n_clusters: int | None = 2
    _: KW_ONLY
    n_neighbours: int = 10
    seed: int = 0
    cut: str = "means"

    def _check_settings(self) -> None:
        check_count(self, "n_neighbours")

    def _express(self, X: Array) -> sp.csr_array:
        from sklearn.neighbors import kneighbors_graph  # slow to import, and who only builds methods needs none

        return sp.csr_array(kneighbors_graph(X.T, min(self.n_neighbours, X.shape[1]), include_self=True))

    def _affinity(self, n_clusters: int | None) -> sp.csr_array:
        return sp.csr_array(0.5 * (self.code_ + self.code_.T))
