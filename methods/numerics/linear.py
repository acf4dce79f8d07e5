"""Symmetric products, factors and eigenvectors by the LAPACK routines that do half the work; the axes of cameras."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg

from nrsfm.methods.base import Array

#: The smallest positive normal double; keeps divisions finite.
TINY = float(np.finfo(np.float64).tiny)


def axes(cameras: Array) -> Array:
    """Complete (F, 2, 3) cameras to rotations Q_f = [r1; r2; r1 x r2], shape (F, 3, 3): the viewing direction is last.

    In these axes R'R of W = R S (Kumar, Dai, Li, 3DV 2016, eq. 1) is diag(1, 1, 0): image rows and depth rows decouple.
    """
    across = np.cross(cameras[:, 0, :], cameras[:, 1, :])
    return np.concatenate([cameras, across[:, None]], axis=1)


def gram(A: Array) -> Array:
    """A'A for an (m, n) array. Only its lower triangle is computed; the rest is zero."""
    if A.flags.c_contiguous:  # A.T is in the order that BLAS wants, so nothing is copied
        product: Array = scipy.linalg.blas.dsyrk(1.0, A.T, lower=1)
    else:
        product = scipy.linalg.blas.dsyrk(1.0, A, trans=1, lower=1)
    return product


def shifted_cholesky(A: Array, shift: float) -> Array:
    """Lower Cholesky factor of A + shift I for :func:`cholesky_solve`; only the lower triangle of A is read."""
    A = A.copy(order="F")
    A[np.diag_indices(len(A))] += shift
    factor: Array = scipy.linalg.cho_factor(A, lower=True, overwrite_a=True, check_finite=False)[0]
    return factor


def cholesky_solve(factor: Array, B: Array) -> Array:
    """X of A X = B by the lower factor of A; B is overwritten where that saves a copy."""
    X: Array = scipy.linalg.cho_solve((factor, True), B, overwrite_b=True, check_finite=False)
    return X


def symmetric_eigen(A: Array) -> tuple[Array, Array]:
    """Eigenvalues, ascending, and eigenvectors of a symmetric array."""
    values, vectors = scipy.linalg.eigh(A, check_finite=False, driver="evd")
    return values, vectors


def unit_rows(U: Array) -> Array:
    """Rows scaled to unit length."""
    rows: Array = U / np.maximum(np.linalg.norm(U, axis=1, keepdims=True), TINY)
    return rows


def without_diagonal(A: Array) -> Array:
    """A itself, its diagonal set to zero in place."""
    np.fill_diagonal(A, 0)
    return A


def conjugate_gradients(
    product: Callable[[Array], Array], B: Array, done: Callable[[Array], bool], *, axis: int, max_steps: int
) -> Array:
    """X of product(X) = B for many right-hand sides at once, vectors along an axis of B (0 or 1), from X = 0.

    ``product`` applies to each vector a symmetric positive definite operator of its own. ``done`` says whether to stop,
    from the squared lengths of all residuals.
    """

    def inner(U: Array, V: Array) -> Array:
        products: Array = np.einsum("ip,ip->i" if axis == 1 else "pi,pi->i", U, V)
        return products

    def over(numerator: Array, denominator: Array) -> Array:
        ratio = numerator / np.maximum(denominator, np.finfo(B.dtype).tiny)
        return ratio[:, None] if axis == 1 else ratio

    X, R, direction = np.zeros_like(B), B.copy(), B.copy()
    rho = inner(R, R)
    for _ in range(max_steps):
        if done(rho):
            break
        through = product(direction)
        step = over(rho, inner(direction, through))
        X += step * direction
        R -= step * through
        before, rho = rho, inner(R, R)
        direction = R + over(rho, before) * direction
    return X
