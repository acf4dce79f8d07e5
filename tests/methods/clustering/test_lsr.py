"""Least squares regression and nearest neighbours: optimality, exact subspaces, and scikit-learn's own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from sklearn.base import BaseEstimator
from sklearn.cluster import SpectralClustering
from sklearn.utils.estimator_checks import parametrize_with_checks

from nrsfm.harness.evaluate.errors import n_wrong
from nrsfm.methods.base import MethodError
from nrsfm.methods.clustering.lsr import LSR, ridge_code
from nrsfm.methods.clustering.neighbours import Neighbours
from tests.methods.clustering.test_clustering import union


@parametrize_with_checks([LSR(), Neighbours()])  # type: ignore[untyped-decorator]
def test_scikit_learn_contract(estimator: BaseEstimator, check: Callable[[BaseEstimator], None]) -> None:
    check(estimator)


def test_each_column_is_a_ridge_regression_on_the_others(rng: np.random.Generator) -> None:
    X, weight = rng.standard_normal((8, 12)), 0.3
    Z = ridge_code(X, weight)
    assert np.abs(np.diag(Z)).max() == 0
    for j in range(12):
        rest = np.delete(X, j, axis=1)
        wanted = np.linalg.solve(rest.T @ rest + weight * np.eye(11), rest.T @ X[:, j])
        np.testing.assert_allclose(np.delete(Z[:, j], j), wanted, atol=1e-10)


@pytest.mark.parametrize("n", [2, 3])
def test_recovers_exact_subspaces(n: int) -> None:
    X, labels = union(n, 3, 30, 25, affine=False)
    assert n_wrong(LSR(n).fit(X).labels_, labels) == 0


def test_neighbours_are_cut_as_scikit_learn_cuts_them(rng: np.random.Generator) -> None:
    X = np.concatenate([rng.standard_normal((30, 4)), 2 + rng.standard_normal((25, 4))])
    other = SpectralClustering(2, affinity="nearest_neighbors", n_neighbors=10, random_state=0).fit(X)
    mine = Neighbours(2).fit(X)
    np.testing.assert_allclose(mine.affinity_matrix_.toarray(), other.affinity_matrix_.toarray())
    assert n_wrong(mine.labels_, other.labels_) == 0


def test_settings_that_cannot_be_are_refused() -> None:
    X = np.random.default_rng(0).standard_normal((10, 4))
    with pytest.raises(MethodError, match="weight"):
        LSR(weight=0.0).fit(X)
    with pytest.raises(MethodError, match="n_neighbours"):
        Neighbours(n_neighbours=0).fit(X)
