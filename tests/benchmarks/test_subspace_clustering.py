"""SSC on a synthetic union of subspaces, against the elastic net and orthogonal matching pursuit of its scalable peers.

The peers code each point with SPAMS, the library that their authors use. Time and error of the whole clustering:
5 subspaces of dimension 6 in R^100, no noise.

You, Li, Robinson, Vidal, "Oracle based active set algorithm for scalable elastic net subspace clustering", CVPR 2016;
You, Robinson, Vidal, "Scalable sparse subspace clustering by orthogonal matching pursuit", CVPR 2016.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp
from pytest_benchmark.fixture import BenchmarkFixture

from nrsfm.harness.evaluate.errors import n_wrong
from nrsfm.methods.clustering.spectral import spectral_clustering
from nrsfm.methods.clustering.ssc import SSC
from nrsfm.methods.clustering.ssc_omp import SSCOMP
from tests.benchmarks.timing import timed

spams = pytest.importorskip("spams")
SUBSPACES, DIMENSION, AMBIENT = 5, 6, 100


def union(n_points: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit points as columns, (100, N), and their subspaces."""
    rng = np.random.default_rng(0)
    labels = np.arange(n_points) % SUBSPACES
    bases = np.linalg.qr(rng.standard_normal((SUBSPACES, AMBIENT, DIMENSION)))[0]
    X = np.einsum("ndk,nk->dn", bases[labels], rng.standard_normal((n_points, DIMENSION)))
    return np.asfortranarray(X / np.linalg.norm(X, axis=0)), labels


def elastic_net(X: np.ndarray, share: float = 0.9, weight: float = 50.0, start: int = 100) -> sp.csc_array:
    """min l |c|_1 + (1 - l)/2 |c|^2 + w/2 |x - X c|^2 for each point, on an active set that grows by its oracle region.

    The weight is relative to the largest product with another point, as in the authors' experiments.
    """
    G = X.T @ X
    np.fill_diagonal(G, 0)
    columns, rows, values = [], [], []
    for j in range(X.shape[1]):
        g = weight * share / np.abs(G[j]).max()
        active = np.argpartition(-np.abs(G[j]), start)[:start]
        for _ in range(20):
            active = active[active != j]
            A = np.asfortranarray(X[:, active])
            c = spams.lasso(X[:, [j]], D=A, lambda1=share / g, lambda2=(1 - share) / g, mode=2, numThreads=1).toarray()[
                :, 0
            ]
            support = active[c != 0]
            region = np.abs(X.T @ (g * (X[:, j] - A @ c))) > share
            region[j] = False
            if not region[np.setdiff1d(np.arange(len(region)), active, assume_unique=True)].any():
                break
            active = np.union1d(support, np.flatnonzero(region))
        columns.append(np.full(len(support), j))
        rows.append(support)
        values.append(c[c != 0])
    places = (np.concatenate(rows), np.concatenate(columns))
    return sp.csc_array((np.concatenate(values), places), shape=(X.shape[1],) * 2)


def matching_pursuit(X: np.ndarray) -> sp.csc_array:
    """The code of each point in ``DIMENSION`` others at most, chosen greedily; its own column is zero meanwhile."""
    D, codes = X.copy(order="F"), []
    for j in range(X.shape[1]):
        column = D[:, j].copy()
        D[:, j] = 0
        codes.append(spams.omp(np.asfortranarray(column[:, None]), D, L=DIMENSION, eps=1e-6, numThreads=1))
        D[:, j] = column
    return sp.csc_array(sp.hstack(codes))


def cluster(code: sp.csc_array) -> np.ndarray:
    A = abs(code)
    return spectral_clustering(A + A.T, SUBSPACES)


SOLVERS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "our SSC": lambda X: SSC(SUBSPACES, alpha=20.0, affine=False).fit(X.T).labels_,
    "elastic net": lambda X: cluster(elastic_net(X)),
    "matching pursuit": lambda X: cluster(matching_pursuit(X)),
    "our matching pursuit": lambda X: SSCOMP(SUBSPACES, n_nonzero=DIMENSION).fit(X.T).labels_,
}


@pytest.mark.parametrize("n_points", [1000, 3275])
@pytest.mark.parametrize("solver", SOLVERS)
def test_union_of_subspaces(benchmark: BenchmarkFixture, solver: str, n_points: int) -> None:
    benchmark.group = f"clustering of {n_points} points on {SUBSPACES} subspaces"
    X, labels = union(n_points)
    result = timed(benchmark, 1 if n_points > 1000 else 3, 0, SOLVERS[solver], X)
    benchmark.extra_info["error"] = n_wrong(result, labels) / n_points
    assert benchmark.extra_info["error"] <= 0.02


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_same_labels_every_time(solver: str) -> None:
    X, _ = union(400)
    np.testing.assert_array_equal(SOLVERS[solver](X), SOLVERS[solver](X))
