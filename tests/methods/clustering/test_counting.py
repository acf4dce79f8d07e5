"""The number of bodies: the eigengap of graphs of known structure, and methods without the number."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from sklearn.base import clone

from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import Array, Method, MethodError
from nrsfm.methods.clustering.edsc import EDSC
from nrsfm.methods.clustering.spectral import MOST, count_clusters, eigengaps, spectral_clustering
from nrsfm.methods.clustering.ssc import SSC
from nrsfm.methods.multibody.adaptive import AdaptiveMultiBody
from nrsfm.methods.multibody.printed import MultiBody
from nrsfm.methods.pipelines import ClusterThenReconstruct, ClusterTracks, ReconstructThenCluster
from nrsfm.methods.structure.bmm import BMM
from tests.methods.clustering.test_clustering import union
from tests.methods.parts import observed, present


def blocks(sizes: list[int], between: float = 0.0, at: int = 0) -> Array:
    """A graph of dense blocks, joined weakly."""
    rng = np.random.default_rng(at)
    labels = np.repeat(np.arange(len(sizes)), sizes)
    A = np.where(labels[:, None] == labels, 1.0, between) * rng.uniform(0.5, 1, (len(labels), len(labels)))
    return A + A.T


@pytest.mark.parametrize("between", [0.0, 0.02])
@pytest.mark.parametrize("sizes", [[12], [9, 14], [8, 20, 11], [9] * 4, [7, 8, 9, 10, 11], [6] * 10])
def test_blocks_are_counted(sizes: list[int], between: float) -> None:
    A = blocks(sizes, between)
    n, gap = count_clusters(A)
    assert n == len(sizes) and 0.3 < gap <= 2
    shuffled = np.random.default_rng(1).permutation(len(A))
    count, same = count_clusters(7 * A[np.ix_(shuffled, shuffled)])
    assert count == n and same == pytest.approx(gap)
    assert len(np.unique(spectral_clustering(A, None))) == n


def test_gaps_are_those_of_the_laplacian() -> None:
    A = blocks([5, 6, 4], 0.3)
    np.fill_diagonal(A, 0)
    D = A.sum(axis=1)
    L = np.eye(len(A)) - A / np.sqrt(np.outer(D, D))
    np.testing.assert_allclose(eigengaps(A), np.diff(np.linalg.eigvalsh(L))[:MOST], atol=1e-12)
    np.testing.assert_allclose(eigengaps(A, 99), np.diff(np.linalg.eigvalsh(L)), atol=1e-12)
    assert abs(np.linalg.eigvalsh(L)[0]) < 1e-12


def test_blocks_that_nothing_joins_have_zero_eigenvalues() -> None:
    """The gap of n separate complete blocks of m points is 1 + 1/(m - 1)."""
    A = np.kron(np.eye(3), np.ones((5, 5)))
    n, gap = count_clusters(A)
    assert n == 3 and gap == pytest.approx(1.25)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_edsc_counts_independent_subspaces(n: int) -> None:
    X, _ = union(n, 3, 40, 20, affine=False)
    model = EDSC(None, affine=False, dimension=3).fit(X)
    assert len(np.unique(model.labels_)) == n


@pytest.mark.parametrize("n", [2, 3])
def test_ssc_counts_independent_subspaces(n: int) -> None:
    X, _ = union(n, 4, 60, 60, affine=False)
    assert len(np.unique(SSC(None, affine=False).fit(X).labels_)) == n


METHODS = [
    ClusterTracks(SSC()),
    ClusterTracks(EDSC()),
    ReconstructThenCluster(BMM(max_iter=50), SSC()),
    ClusterThenReconstruct(SSC(), BMM(max_iter=50)),
    AdaptiveMultiBody(max_iter=30),
    MultiBody(max_iter=30),
]


@pytest.mark.parametrize("method", METHODS, ids=lambda m: type(m).__name__)
def test_every_method_estimates_the_number_of_bodies(small_scene: Scene, method: Method) -> None:
    counted = clone(method).reconstruct(observed(small_scene), None)
    n = len(np.unique(present(counted.labels)))
    if "EDSC" not in repr(method):  # whose affinity depends on the number
        assert n == count_clusters(present(counted.affinity))[0]
    with_number = clone(method).reconstruct(observed(small_scene), n) if n > 1 else counted
    np.testing.assert_array_equal(present(with_number.labels), present(counted.labels))


def test_a_projection_by_bodies_needs_their_number(small_scene: Scene) -> None:
    with pytest.raises(MethodError, match="set n_bodies"):
        ClusterTracks(SSC(), projection=4).reconstruct(observed(small_scene), None)


@pytest.mark.parametrize("between", [0.0, 0.05])
def test_sparse_graphs_are_counted_alike(between: float) -> None:
    A = blocks([8, 20, 11], between)
    A[A < 0.04] = 0
    np.testing.assert_allclose(eigengaps(sp.csr_array(A)), eigengaps(A), atol=1e-8)
    assert count_clusters(sp.csr_array(A))[0] == 3
    alone = np.zeros((40, 40))
    alone[:39, :39] = A  # a point that nothing joins
    np.testing.assert_allclose(eigengaps(sp.csr_array(alone)), eigengaps(alone), atol=1e-8)
