"""Half products, factors and eigenvectors against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from nrsfm.methods.numerics.linear import (
    cholesky_solve,
    conjugate_gradients,
    gram,
    shifted_cholesky,
    symmetric_eigen,
    without_diagonal,
)


def test_factors_of_half_products_solve(rng: np.random.Generator) -> None:
    A, B = rng.standard_normal((20, 9)), rng.standard_normal((9, 4))
    for ordered in (A, np.asfortranarray(A)):
        G = gram(ordered)
        np.testing.assert_allclose(np.tril(G), np.tril(A.T @ A), atol=1e-12)
        X = cholesky_solve(shifted_cholesky(G, 0.5), B.copy())
        np.testing.assert_allclose((A.T @ A + 0.5 * np.eye(9)) @ X, B, atol=1e-10)


def test_eigenvectors_of_a_symmetric_array(rng: np.random.Generator) -> None:
    A = rng.standard_normal((7, 7))
    A = A + A.T
    values, vectors = symmetric_eigen(A)
    assert (np.diff(values) >= 0).all()
    np.testing.assert_allclose(vectors * values @ vectors.T, A, atol=1e-12)


def test_the_diagonal_is_cleared_in_place() -> None:
    A = np.ones((3, 3))
    assert without_diagonal(A) is A and A.sum() == 6 and not A.diagonal().any()


@pytest.mark.parametrize("axis", [0, 1])
def test_conjugate_gradients_solve_many_systems_at_once(rng: np.random.Generator, axis: int) -> None:
    A = np.eye(9) + 0.1 * gram(rng.standard_normal((9, 9)).T + 0.0)
    A = np.tril(A) + np.tril(A, -1).T
    B = rng.standard_normal((9, 4))
    if axis == 0:
        X = conjugate_gradients(lambda X: A @ X, B, lambda rho: bool(rho.max() < 1e-24), axis=0, max_steps=99)
    else:
        X = conjugate_gradients(lambda X: X @ A, B.T, lambda rho: bool(rho.max() < 1e-24), axis=1, max_steps=99).T
    np.testing.assert_allclose(A @ X, B, atol=1e-11)
