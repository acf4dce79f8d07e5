"""Elastic net codes: optimality, agreement with scikit-learn's solver, and exact subspaces."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from sklearn.base import BaseEstimator
from sklearn.linear_model import ElasticNet
from sklearn.utils.estimator_checks import parametrize_with_checks

from nrsfm.harness.evaluate.errors import n_wrong
from nrsfm.methods.base import MethodError
from nrsfm.methods.clustering.ensc import EnSC, elastic_net
from nrsfm.methods.clustering.lsr import ridge_code
from tests.methods.clustering.test_clustering import union


@parametrize_with_checks([EnSC()])  # type: ignore[untyped-decorator]
def test_scikit_learn_contract(estimator: BaseEstimator, check: Callable[[BaseEstimator], None]) -> None:
    check(estimator)


@pytest.mark.parametrize("mixing", [0.1, 0.5, 0.95])
@pytest.mark.parametrize("weight", [1.0, 20.0, 3000.0])
def test_the_code_is_optimal(rng: np.random.Generator, weight: float, mixing: float) -> None:
    """0 is a subgradient: d_i = mixing sign(c_i) + (1 - mixing) c_i on the support, |d_i| <= mixing off it."""
    X, x = rng.standard_normal((8, 20)), rng.standard_normal(8)
    c = elastic_net(X.T @ X, X.T @ x, weight, mixing)
    d, on = weight * X.T @ (x - X @ c), c != 0
    np.testing.assert_allclose(d[on], mixing * np.sign(c[on]) + (1 - mixing) * c[on], atol=1e-7)
    assert np.abs(d[~on]).max(initial=0) <= mixing * (1 + 1e-8)


def test_the_code_is_that_of_scikit_learn(rng: np.random.Generator) -> None:
    X, x, weight, mixing = rng.standard_normal((10, 15)), rng.standard_normal(10), 4.0, 0.6
    other = ElasticNet(1 / (weight * 10), l1_ratio=mixing, fit_intercept=False, tol=1e-12, max_iter=100000).fit(X, x)
    np.testing.assert_allclose(elastic_net(X.T @ X, X.T @ x, weight, mixing), other.coef_, atol=1e-7)


def test_dense_codes_are_ridge_regressions(rng: np.random.Generator) -> None:
    """At a mixing of nearly 0 the code is that of least squares regression."""
    X = rng.standard_normal((6, 9))
    Z, weight = ridge_code(X, 0.25), 4.0
    rest = X[:, 1:]
    np.testing.assert_allclose(elastic_net(rest.T @ rest, rest.T @ X[:, 0], weight, 1e-9), Z[1:, 0], atol=1e-6)


def test_small_weights_give_no_code(rng: np.random.Generator) -> None:
    X, x = rng.standard_normal((8, 20)), rng.standard_normal(8)
    vanishing = 0.5 / np.abs(X.T @ x).max()
    assert not elastic_net(X.T @ X, X.T @ x, 0.999 * vanishing, 0.5).any()
    assert np.count_nonzero(elastic_net(X.T @ X, X.T @ x, 1.001 * vanishing, 0.5)) == 1


@pytest.mark.parametrize("n", [2, 3])
def test_recovers_exact_subspaces(n: int) -> None:
    X, labels = union(n, 3, 30, 25, affine=False)
    assert n_wrong(EnSC(n).fit(X).labels_, labels) == 0


@pytest.mark.parametrize("mixing", [0.0, 1.0, 1.5])
def test_mixings_that_cannot_be_are_refused(mixing: float) -> None:
    with pytest.raises(MethodError, match="mixing"):
        EnSC(mixing=mixing).fit(np.random.default_rng(0).standard_normal((10, 4)))
