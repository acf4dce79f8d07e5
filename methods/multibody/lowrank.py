"""Sparse plus low-rank matrices that stand for the code and its multiplier, and products with blocks of their rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from nrsfm.methods.base import Array
from nrsfm.methods.multibody.spatial import Neighbours


@dataclass
class Code:
    """C = (A + L'R) G^-1: A (P, P) sparse, L and R (k, P), G of the neighbours (I without).

    ``M`` and ``V`` are this step's low-rank part V'M, and ``fixed`` is E D' of the E that it started from.
    ``operations`` counts the multiplications and additions of its products.
    """

    A: sp.csr_array
    L: Array
    R: Array
    neighbours: Neighbours | None
    V: Array
    M: Array
    fixed: sp.csr_array
    operations: float = 0.0

    def apply(self, X: Array) -> Array:
        """C X for (P, m) columns."""
        self._count(X.shape[1])
        Y = X if self.neighbours is None else self.neighbours.solve(X)
        product: Array = self.A @ Y + self.L.T @ (self.R @ Y)
        return product

    def apply_transposed(self, X: Array) -> Array:
        """C'X for (P, m) columns."""
        self._count(X.shape[1])
        Y = self.A.T @ X + self.R.T @ (self.L @ X)
        return Y if self.neighbours is None else self.neighbours.solve(Y)

    def _count(self, columns: int) -> None:
        self.operations += 2.0 * columns * (self.A.nnz + 2 * self.L.size)

    def rows(self, at: slice) -> Array:
        """Rows of C, (m, P)."""
        return rows_of(self.L, self.R, self.A, at, self.neighbours)


@dataclass(frozen=True)
class Multiplier:
    """U = Y3/b at the penalty ``b``: U D' = V'M + drift, and the rest of U, which D' maps to 0, -J (I - D'G^-1 D)."""

    V: Array
    M: Array
    drift: sp.csr_array
    J: sp.csr_array | None
    b: float


def rows_of(L: Array, R: Array, A: sp.csr_array, at: slice, neighbours: Neighbours | None) -> Array:
    """Rows of (L'R + A) G^-1, (m, P)."""
    block = L[:, at].T @ R
    add_rows(block, A, at)
    return block if neighbours is None else neighbours.solve(block.T).T


def add_rows(block: Array, A: sp.csr_array, at: slice, sign: int = 1) -> None:
    """block += sign A[at], without a matrix of those rows."""
    for row, place in zip(block, range(at.start, at.stop, at.step or 1), strict=True):
        entries = slice(A.indptr[place], A.indptr[place + 1])
        row[A.indices[entries]] += sign * A.data[entries]


def soft_sparse(Z: Array, threshold: float) -> sp.csr_array:
    """The soft threshold of (m, n) rows, as a sparse matrix of its few non-zero entries."""
    above = np.abs(Z) > threshold
    places = np.flatnonzero(above)
    values = Z.ravel()[places]
    values -= np.copysign(threshold, values)
    ends = np.searchsorted(places, np.arange(len(Z) + 1) * Z.shape[1])
    indices = places - np.repeat(np.arange(len(Z)) * Z.shape[1], np.diff(ends))
    return sp.csr_array((values, indices.astype(np.int32), ends), shape=Z.shape)
