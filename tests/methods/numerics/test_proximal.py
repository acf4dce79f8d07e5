"""Proximal steps: Moreau's decomposition and agreement with plain references."""

from __future__ import annotations

import numpy as np
import pytest

from nrsfm.methods.numerics.proximal import singular_value_threshold, soft


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
