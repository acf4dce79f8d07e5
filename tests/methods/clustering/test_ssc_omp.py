"""Orthogonal matching pursuit: against a plain pursuit and scikit-learn's, and on exact subspaces."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from sklearn.linear_model import orthogonal_mp

from nrsfm.harness.evaluate.errors import n_wrong
from nrsfm.methods.base import MethodError
from nrsfm.methods.clustering import ssc_omp
from nrsfm.methods.clustering.ssc_omp import SSCOMP, matching_pursuit
from tests.methods.clustering.test_clustering import union


def plain(X: np.ndarray, n_nonzero: int, residual: float) -> np.ndarray:
    """Algorithm 1 as it is written, a point at a time."""
    X = X / np.linalg.norm(X, axis=0)
    C = np.zeros((X.shape[1],) * 2)
    for j in range(X.shape[1]):
        support: list[int] = []
        r, c = X[:, j], np.zeros(0)
        while len(support) < n_nonzero and np.linalg.norm(r) > residual:
            products = np.abs(X.T @ r)
            products[[j, *support]] = -1
            support.append(int(products.argmax()))
            c = np.linalg.lstsq(X[:, support], X[:, j], rcond=None)[0]
            r = X[:, j] - X[:, support] @ c
        C[support, j] = c
    return C


@pytest.mark.parametrize(("n_nonzero", "residual"), [(1, 0.0), (4, 0.0), (8, 0.3), (50, 1e-6)])
def test_the_code_is_that_of_the_plain_pursuit(
    rng: np.random.Generator, n_nonzero: int, residual: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ssc_omp, "BLOCK", 7)  # several blocks, the last not full
    X = rng.standard_normal((12, 30))
    C = matching_pursuit(X, n_nonzero, residual)
    assert C.diagonal().max() == 0
    np.testing.assert_allclose(C.toarray(), plain(X, min(n_nonzero, 12), residual), atol=1e-8)


def test_the_code_is_that_of_scikit_learn(rng: np.random.Generator) -> None:
    X = rng.standard_normal((15, 25))
    X /= np.linalg.norm(X, axis=0)
    C = matching_pursuit(X, 5, 0.0).toarray()
    for j in range(25):
        rest = np.delete(X, j, axis=1)
        np.testing.assert_allclose(np.delete(C[:, j], j), orthogonal_mp(rest, X[:, j], n_nonzero_coefs=5), atol=1e-8)


@pytest.mark.parametrize("n", [2, 3])
def test_recovers_exact_subspaces(n: int) -> None:
    X, labels = union(n, 3, 30, 25, affine=False)
    fitted = SSCOMP(n, n_nonzero=3).fit(X)
    assert n_wrong(fitted.labels_, labels) == 0
    joined = fitted.code_.tocoo()
    assert (labels[joined.coords[0]] == labels[joined.coords[1]]).all()  # the code keeps to the subspaces


def test_points_that_are_the_same_or_at_the_origin() -> None:
    X = np.array([[1.0, 1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0]])
    C = matching_pursuit(X, 3, 1e-6)
    assert np.isfinite(C.data).all()
    unit = X / np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    np.testing.assert_allclose(unit[:, :3] @ C.toarray()[:3, :3], unit[:, :3], atol=1e-12)
    assert C[:, [4]].nnz == 0
    assert C[[4], :].nnz == 0


@pytest.mark.parametrize("settings", [{"n_nonzero": 0}, {"n_nonzero": 2.5}, {"residual": -1.0}])
def test_settings_that_cannot_be_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match=next(iter(settings))):
        SSCOMP(2, **settings).fit(np.eye(5))


def test_no_array_of_all_pairs_is_made() -> None:
    """The peak stays below one such array, and below what is foreseen."""
    n = 6000
    X = np.random.default_rng(0).standard_normal((n, 10))
    model = SSCOMP(2, n_nonzero=4)
    tracemalloc.start()
    matching_pursuit(X.T, 4, 1e-6)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < model.memory(n, 10) < 8 * n**2
    assert sp.issparse(model.fit(X[:200]).affinity_matrix_)
