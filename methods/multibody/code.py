"""The code step of both formulations: a ridge regression of the tracks on each other."""

from __future__ import annotations

import numpy as np

from nrsfm.methods.base import Array
from nrsfm.methods.numerics.linear import cholesky_solve, gram, shifted_cholesky, without_diagonal


def solve_code(V: Array, H: Array, N: Array, diagonal: str) -> Array:
    """C of (V'V + I) C = V'H + N for V, H (r, P) and N (P, P).

    The smaller of two matrices is factored, V'V + I or V V' + I: with C = N + V'T, (V V' + I) T = H - V N.
    O(r P min(r, P) + r P^2).

    Parameters
    ----------
    V, H, N : arrays
    diagonal : {"threshold", "exact", "paper"}
        ``exact`` solves under diag(C) = 0, ``paper`` subtracts the diagonal of the solution, ``threshold`` leaves it.
    """
    r, P = V.shape
    if r < P:
        factor = shifted_cholesky(gram(V.T), 1.0)
        C: Array = N + V.T @ cholesky_solve(factor, H - V @ N)
    else:
        factor = shifted_cholesky(gram(V), 1.0)
        C = cholesky_solve(factor, V.T @ H + N)
    if diagonal == "exact":  # multipliers m of diag(C) = 0: C = K^-1 (rhs - diag(m)), K = V'V + I
        whole = np.eye(P)
        inverse = whole - V.T @ cholesky_solve(factor, V.copy()) if r < P else cholesky_solve(factor, whole)
        C = C - inverse * (np.diagonal(C) / np.diagonal(inverse))
    return without_diagonal(C) if diagonal == "paper" else C
