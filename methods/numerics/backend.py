"""The dense solver's arrays: numpy, or any library with the array API, such as PyTorch on a graphics card.

numpy's own arrays go to LAPACK's symmetric routines; PyTorch's to its Cholesky solver; others to what the array API
standard (2023.12) has.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg

from nrsfm.methods.base import MethodError

#: An array of whatever library.
Tensor = Any


def namespace(x: Tensor) -> Any:
    """The array API namespace of an array."""
    if isinstance(x, np.ndarray):
        return np
    import array_api_compat

    return array_api_compat.array_namespace(x)


def on_device(x: np.ndarray, device: str | None) -> Tensor:
    """The array as PyTorch holds it on a device, ``cpu`` or ``cuda``; as it is for None.

    Raises
    ------
    MethodError
        If PyTorch is not installed or has no such device.
    """
    if device is None:
        return x
    try:
        import array_api_compat  # noqa: F401
        import torch
    except ImportError:
        raise MethodError(
            f"method.device is {device!r} and PyTorch is not installed: pip install 'nrsfm[gpu]', or null"
        ) from None
    try:
        return torch.asarray(x, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise MethodError(f"method.device is {device!r}: {reason}; null computes with numpy") from None


def to_numpy(x: Tensor) -> Any:
    """An array of any library as numpy's; sparse matrices and numbers as they are."""
    if hasattr(x, "detach"):
        x = x.detach().cpu()
    return np.asarray(x) if hasattr(x, "__array_namespace__") or hasattr(x, "detach") else x


def largest(x: Tensor) -> float:
    """max |x|."""
    return float(np.abs(x).max()) if isinstance(x, np.ndarray) else float(namespace(x).max(namespace(x).abs(x)))


def absolute_sum(x: Tensor) -> float:
    """|x|_1, of a sparse matrix too."""
    dense = not hasattr(x, "tocsr") and not isinstance(x, np.ndarray)
    return float(namespace(x).sum(namespace(x).abs(x)) if dense else abs(x).sum())


def zeros(shape: tuple[int, ...], like: Tensor) -> Tensor:
    """Zeros where ``like`` is, of its type."""
    return namespace(like).zeros(shape, dtype=like.dtype, **_place(like))


def identity(n: int, like: Tensor) -> Tensor:
    """The (n, n) identity where ``like`` is, of its type."""
    return namespace(like).eye(n, dtype=like.dtype, **_place(like))


def without_diagonal(A: Tensor) -> Tensor:
    """A with a zero diagonal; numpy's is changed in place."""
    if isinstance(A, np.ndarray):
        np.fill_diagonal(A, 0)
        return A
    return A * (1 - identity(A.shape[0], A))


def gram(A: Tensor) -> Tensor:
    """A'A for an (m, n) array; numpy's holds the lower triangle, the rest zero: half the work of the product."""
    if not isinstance(A, np.ndarray):
        return A.T @ A
    if A.flags.c_contiguous:  # A.T is in the order that BLAS wants, so nothing is copied
        return scipy.linalg.blas.dsyrk(1.0, A.T, lower=1)
    return scipy.linalg.blas.dsyrk(1.0, A, trans=1, lower=1)


def shifted_cholesky(A: Tensor, shift: float) -> tuple[Tensor, bool]:
    """Cholesky factor of A + shift I, of which the lower triangle is given; for :func:`cholesky_solve`."""
    if isinstance(A, np.ndarray):
        A = A.copy(order="F")
        A[np.diag_indices(len(A))] += shift
        return scipy.linalg.cho_factor(A, lower=True, overwrite_a=True, check_finite=False)
    return namespace(A).linalg.cholesky(A + shift * identity(A.shape[0], A)), True


def cholesky_solve(factor: tuple[Tensor, bool], B: Tensor) -> Tensor:
    """X of A X = B by the factor of A; numpy's B is overwritten where that saves a copy."""
    L = factor[0]
    if isinstance(L, np.ndarray):
        return scipy.linalg.cho_solve(factor, B, overwrite_b=True, check_finite=False)
    if hasattr(L, "detach"):
        import torch

        return torch.cholesky_solve(B, L)
    solve = namespace(L).linalg.solve
    return solve(L.T, solve(L, B))


def symmetric_eigen(A: Tensor) -> tuple[Tensor, Tensor]:
    """Eigenvalues, ascending, and eigenvectors of a symmetric array."""
    if isinstance(A, np.ndarray):
        return scipy.linalg.eigh(A, check_finite=False, driver="evd")
    return tuple(namespace(A).linalg.eigh(A))


def thin_svd(A: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """U, s, V' with as many vectors as the shorter side."""
    if isinstance(A, np.ndarray):
        return scipy.linalg.svd(A, full_matrices=False, check_finite=False)
    return tuple(namespace(A).linalg.svd(A, full_matrices=False))


def _place(like: Tensor) -> dict[str, Any]:
    return {} if isinstance(like, np.ndarray) else {"device": like.device}
