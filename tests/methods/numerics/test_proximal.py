"""Proximal steps: Moreau's decomposition and agreement with plain references."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from nrsfm.methods.numerics.proximal import singular_value_threshold, soft, weighted_singular_value_threshold


def test_soft_threshold_is_moreau(rng: np.random.Generator) -> None:
    """x = prox(x) + projection onto the dual ball."""
    X = rng.standard_normal((20, 30))
    np.testing.assert_allclose(soft(X, 0.3) + np.clip(X, -0.3, 0.3), X)
    np.testing.assert_allclose(soft(X, 0.3), np.sign(X) * np.maximum(np.abs(X) - 0.3, 0), atol=1e-15)


@pytest.mark.parametrize("shape", [(20, 60), (60, 20)])
@pytest.mark.parametrize("threshold", [1e-9, 0.5, 5.0, 100.0])
def test_singular_value_threshold_matches_the_svd(
    rng: np.random.Generator, shape: tuple[int, int], threshold: float
) -> None:
    M = rng.standard_normal(shape)
    U, s, Vt = np.linalg.svd(M, full_matrices=False)
    wanted = (U * np.maximum(s - threshold, 0)) @ Vt
    shrunk, norm = singular_value_threshold(M, threshold)
    np.testing.assert_allclose(shrunk, wanted, atol=1e-9)
    assert norm == pytest.approx(np.maximum(s - threshold, 0).sum(), abs=1e-9)
    assert np.linalg.norm(M - shrunk, 2) <= threshold * (1 + 1e-3)  # Moreau: what is taken off lies in the dual ball


@pytest.mark.parametrize("thresholds", [[0.0, 0.5, 0.9, 4.0], [0.0, 0.0, 0.3, 0.3], [9.0, 9.0, 9.0, 9.0]])
def test_weighted_threshold_is_the_minimiser(rng: np.random.Generator, thresholds: list[float]) -> None:
    """Of sum_i t_i sigma_i(X) + 1/2 |X - M|^2: no X of a descent from many starts is cheaper."""
    M, t = rng.standard_normal((4, 6)), np.array(thresholds)

    def cost(x: np.ndarray) -> float:
        X = x.reshape(M.shape)
        return float(t @ np.linalg.svd(X, compute_uv=False) + 0.5 * np.sum((X - M) ** 2))

    found = weighted_singular_value_threshold(M, t)
    starts = [M.ravel(), found.ravel() + 1e-3 * rng.standard_normal(M.size), *rng.standard_normal((5, M.size))]
    lowest = min(minimize(cost, start, method="Powell", options={"maxiter": 20}).fun for start in starts)
    assert cost(found) <= lowest + 1e-6


def test_equal_thresholds_are_the_nuclear_norm(rng: np.random.Generator) -> None:
    M = rng.standard_normal((7, 5))
    np.testing.assert_allclose(
        weighted_singular_value_threshold(M, np.full(5, 0.7)), singular_value_threshold(M, 0.7)[0], atol=1e-12
    )
