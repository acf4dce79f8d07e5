"""Low-rank representation: the closed form, optimality of the noisy one, outliers, exact subspaces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg

from nrsfm.harness.evaluate.errors import n_wrong
from nrsfm.methods.base import MethodError
from nrsfm.methods.clustering.lrr import LRR, low_rank_code
from tests.methods.clustering.test_clustering import union


def value(X: np.ndarray, Z: np.ndarray, weight: float) -> float:
    """|Z|_* + weight |X - X Z|_2,1."""
    return float(np.linalg.svd(Z, compute_uv=False).sum() + weight * np.linalg.norm(X - X @ Z, axis=0).sum())


def test_without_noise_it_is_the_shape_interaction_matrix() -> None:
    """V V' of rank r expresses the points, and no other Z that does has a smaller nuclear norm, theorem 4.1."""
    X = union(2, 3, 20, 10, affine=False)[0].T
    Z, iterations = low_rank_code(X, None, 1, 1e-9)
    assert iterations == 1
    np.testing.assert_allclose(X @ Z, X, atol=1e-9)
    np.testing.assert_allclose(Z @ Z, Z, atol=1e-9)
    assert np.trace(Z) == pytest.approx(6)
    null = scipy.linalg.null_space(X)
    rng = np.random.default_rng(0)
    for _ in range(20):
        other = Z + null @ rng.standard_normal((null.shape[1], len(Z)))
        assert np.linalg.svd(other, compute_uv=False).sum() >= 6


@pytest.mark.parametrize("weight", [0.1, 0.5, 4.0])
def test_with_noise_no_change_lowers_the_objective(rng: np.random.Generator, weight: float) -> None:
    X = union(2, 3, 20, 10, affine=False)[0].T + 0.1 * rng.standard_normal((20, 20))
    Z, _ = low_rank_code(X, weight, 20000, 1e-9)
    best = value(X, Z, weight)
    assert best <= min(value(X, np.zeros_like(Z), weight), value(X, low_rank_code(X, None, 1, 1e-9)[0], weight)) + 1e-6
    for _ in range(200):
        change = rng.standard_normal(Z.shape) * 10.0 ** rng.uniform(-5, -1)
        assert value(X, Z + change, weight) >= best - 1e-6


def test_a_heavy_weight_is_the_closed_form() -> None:
    X = union(2, 3, 20, 10, affine=False)[0].T
    np.testing.assert_allclose(low_rank_code(X, 1e3, 20000, 1e-9)[0], low_rank_code(X, None, 1, 1e-9)[0], atol=1e-5)


def test_the_code_follows_points_and_not_axes(rng: np.random.Generator) -> None:
    X = union(2, 3, 20, 10, affine=False)[0].T + 0.1 * rng.standard_normal((20, 20))
    turn = np.linalg.qr(rng.standard_normal((20, 20)))[0]
    order = rng.permutation(20)
    Z = low_rank_code(X, 0.5, 20000, 1e-9)[0]
    np.testing.assert_allclose(low_rank_code(turn @ X, 0.5, 20000, 1e-9)[0], Z, atol=1e-5)
    np.testing.assert_allclose(low_rank_code(X[:, order], 0.5, 20000, 1e-9)[0], Z[np.ix_(order, order)], atol=1e-5)


@pytest.mark.parametrize("n", [2, 3])
def test_recovers_exact_subspaces(n: int) -> None:
    X, labels = union(n, 3, 30, 25, affine=False)
    for weight in (None, 0.5, 4.0):
        assert n_wrong(LRR(n, weight=weight).fit(X).labels_, labels) == 0


def test_light_weights_give_up_points_and_keep_the_rest_low_rank(rng: np.random.Generator) -> None:
    """The columns' lengths are for whole points: those of no subspace are left to E, the others are expressed."""
    X, labels = union(2, 3, 60, 40, affine=False)
    X = np.concatenate([X, rng.standard_normal((4, 60)) / 4]).T
    Z, _ = low_rank_code(X, 0.3, 20000, 1e-9)
    left = np.linalg.norm(X - X @ Z, axis=0) / np.linalg.norm(X, axis=0)
    assert left[:80].max() < 0.5 * left[80:].min()
    assert np.linalg.matrix_rank(Z[:, :80], tol=1e-3) <= 6
    assert n_wrong(LRR(2, weight=0.3).fit(X.T).labels_[:80], labels) == 0


@pytest.mark.parametrize("settings", [{"weight": 0.0}, {"weight": -1.0}, {"power": 0.0}, {"max_iter": 0}, {"tol": 0.0}])
def test_settings_that_cannot_be_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match=next(iter(settings))):
        LRR(2, **settings).fit(np.eye(5))
