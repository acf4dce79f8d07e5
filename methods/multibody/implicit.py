"""The printed iteration without a P x P array: C and Y3 as sparse plus low-rank matrices.

With V = [S; 1'] (r, P), the C-step's optimality reads C G = V'M + (E - U) D' for an (r, P) matrix M and U = Y3/b,
and the E-step's soft threshold splits Z = C D + U into E and the new U. So U D' = V'M + (E_old - E) D', and the part
of U that D' does not see is minus the sum J of all E so far (each scaled as b grew since). Hence, with s the penalty
of the last step over that of this one,

    C = (V'M - s V_old'M_old + E D' - s (E_old - E) D') G^-1
    Z = (V'M + (E + s J) D') G^-1 D - s J

in which V'M is dense but never stored: Z is computed and thresholded in blocks of rows. Without the spatial term
G = D = I, J drops out, and Z = V'M + E. The S-step takes conjugate gradients with C as an operator. The iterates are
those of :class:`nrsfm.methods.multibody.lagrangian.PrintedProblem` and
:class:`nrsfm.methods.multibody.spatial.SpatialProblem`, to rounding.

Operations an iteration, for Z of rank k <= r with q entries of E: 2 k P^2 + O(P^2) for Z, O(r^2 P) for M, and for each
step of conjugate gradients on m <= 3F rows 8 k m P + 4 m q. Memory O(r P + q).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import KW_ONLY, dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from threadpoolctl import ThreadpoolController

from nrsfm.methods.base import Array
from nrsfm.methods.multibody.lagrangian import PrintedProblem
from nrsfm.methods.multibody.lowrank import Code, Multiplier, add_rows, rows_of, soft_sparse
from nrsfm.methods.multibody.problem import Gaps, State
from nrsfm.methods.multibody.spatial import Neighbours
from nrsfm.methods.numerics.linear import axes, conjugate_gradients

ENTRIES = 400  # of E per track, assumed by implicit_bytes
BLOCK_BYTES = 4 << 20  # of a block of Z, so that it stays in the cache
GAP_ROWS = 1000  # the most rows of C, evenly spaced, that the code's residual is taken over


@dataclass(frozen=True)
class ImplicitProblem(PrintedProblem):
    """The printed Lagrangian with C a :class:`~nrsfm.methods.multibody.lowrank.Code`, E sparse, Y3 a Multiplier.

    ``dtype`` is that of Z and of the conjugate gradients; everything of r rows and the multipliers is in float64.
    """

    _: KW_ONLY
    neighbours: Neighbours | None = None  # of the spatial term; None is D = I
    dtype: Any = np.float64
    cg_tol: float = 1e-13  # relative residual of the conjugate gradients; this one is exact to rounding in float64

    def start(self, b: float, S: Array | None = None) -> State:
        """S (by default pinv(R) W), S# = g(S), all else zero."""
        S = self.cameras.transpose(0, 2, 1) @ self.W if S is None else S
        P = S.shape[2]
        zero, none = np.zeros_like(S), np.zeros((0, P), dtype=self.dtype)
        empty = sp.csr_array((P, P), dtype=self.dtype)
        E = empty if self.neighbours is None else sp.csr_array(self.neighbours.D.shape, dtype=self.dtype)
        U = Multiplier(none, none, empty, None if self.neighbours is None else E, b)
        C = Code(empty, none, none, self.neighbours, none, none, empty)
        return State(S=S, shape=S, C=C, E=E, Y1=zero, Y2=zero, Y3=U, Y4=np.zeros(P), b=b)

    def code_step(self, state: State) -> Code:
        """C of eq. (20): V V'M + M G = H G - V (E - U) D' in the eigenvectors of V V'.

        Directions of V that are fainter than the tolerance of the S-step are left out.
        """
        U = state.Y3
        s = U.b / state.b
        V, H = self.code_rows(state)
        fixed = state.E if self.neighbours is None else (state.E @ self.neighbours.D.T).tocsr()
        A = (fixed - s * U.drift).tocsr()
        Q, k = _leading(V, self.cg_tol)
        V, H = Q.T @ V, Q.T @ H
        known = (A.T @ V.T).T - s * (V @ U.V.T) @ U.M
        if self.neighbours is None:
            M = (H - known) / (1 + k)[:, None]
        else:
            M = self.neighbours.solve_shifted((self.neighbours.G @ H.T).T - known, k)
        V, M = V.astype(self.dtype), M.astype(self.dtype)
        L, R = np.concatenate([V, U.V]), np.concatenate([M, (-s * U.M).astype(self.dtype)])
        return Code(A.astype(self.dtype), L, R, self.neighbours, V, M, fixed)

    def sparse_step(self, state: State) -> sp.csr_array:
        """E of eq. (18): the soft threshold of Z at l1/b, in blocks of rows of Z."""
        C, U, threshold = state.C, state.Y3, self.dtype(self.l1 / state.b)
        seen = unseen = C.fixed
        if self.neighbours is not None:
            unseen = ((U.b / state.b) * U.J).tocsr()
            seen = ((state.E + unseen) @ self.neighbours.D.T).tocsr()

        def block(at: slice) -> sp.csr_array:
            Z = rows_of(C.V, C.M, seen, at, self.neighbours)
            if self.neighbours is not None:
                Z = self.neighbours.differences(Z)
                add_rows(Z, unseen, at, -1)
            Z[np.arange(len(Z)), np.arange(at.start, at.stop)] = 0
            return soft_sparse(Z, threshold)

        return sp.vstack(list(self._map(block, state.E.shape[1])), format="csr")

    def structure_step(self, state: State) -> Array:
        """S of eq. (14) by conjugate gradients from the S before, in each frame's own axes.

        Image rows solve X (B + (1 + 1/b) I) = rhs and depth rows X (B + I) = rhs with B = (I - C)(I - C)'. Only the
        residual of the start is solved for, and its rows are first brought down to the directions that matter.
        """
        b, C = state.b, state.C
        F, _, P = state.S.shape
        Q = axes(self.cameras)
        X = Q @ state.S
        wanted = Q @ (state.shape + state.Y1 / b)
        wanted[:, :2] += self.W / b
        through = X - self._product(C.apply_transposed, X) + Q @ state.Y2 / b
        left = wanted - X - through + self._product(C.apply, through)
        left[:, :2] -= X[:, :2] / b
        for rows, shift in ((slice(0, 2), 1 + 1 / b), (slice(2, 3), 1.0)):
            flat = left[:, rows].reshape(-1, P)
            allowed = self.cg_tol * float(np.linalg.norm(wanted[:, rows]))
            basis = _leading(flat, 0.3 * allowed / (float(np.linalg.norm(flat)) or 1.0))[0]
            few = np.ascontiguousarray((basis.T @ flat).T.astype(self.dtype))
            solved = self._solve_normal(C, few, shift, allowed)
            X[:, rows] += (basis @ solved.T).reshape(F, -1, P)
        S: Array = Q.transpose(0, 2, 1) @ X
        return S

    def _product(self, product: Callable[[Array], Array], X: Array) -> Array:
        """X C or X C' for (F, 3, P) trajectories, by the leading directions of their 3F rows."""
        flat = X.reshape(-1, X.shape[2])
        basis = _leading(flat, 0.3 * self.cg_tol)[0]
        few = np.ascontiguousarray((basis.T @ flat).T.astype(self.dtype))
        result: Array = (basis @ product(few).T.astype(float)).reshape(X.shape)
        return result

    def _solve_normal(self, C: Code, B: Array, shift: float, allowed: float) -> Array:
        """X of ((I - C)(I - C)' + shift I) X = B for (P, m) columns, to a residual of Frobenius norm ``allowed``."""

        def product(X: Array) -> Array:
            Y = X - C.apply_transposed(X)
            result: Array = Y - C.apply(Y) + self.dtype(shift) * X
            return result

        return conjugate_gradients(product, B, lambda rho: bool(rho.sum() <= allowed**2), axis=0, max_steps=200)

    def gaps(self, state: State) -> Gaps:
        """S# - g(S), S - S C, the largest entry of C D - E, and 1'C - 1'."""
        ones = np.ones((state.S.shape[2], 1), dtype=self.dtype)
        return {
            "shape": state.shape - state.S,
            "expression": state.S - self._product(state.C.apply_transposed, state.S),
            "code": self.code_gap(state),
            "affine": state.C.apply_transposed(ones)[:, 0].astype(float) - 1,
        }

    def code_gap(self, state: State) -> Array:
        """max |C D - E|, shape (), over at most ``GAP_ROWS`` rows; all rows would double the cost of the iteration."""
        step = -(-self.W.shape[2] // GAP_ROWS)

        def block(at: slice) -> float:
            at = slice(-(-at.start // step) * step, at.stop, step)
            if at.start >= at.stop:
                return 0.0
            rows = state.C.rows(at)
            if self.neighbours is not None:
                rows = self.neighbours.differences(rows)
            add_rows(rows, state.E, at, -1)
            return float(max(rows.max(), -rows.min()))

        return np.array(max(self._map(block, state.E.shape[1])))

    def multiplier_step(self, state: State, gaps: Gaps) -> State:
        """Y += b times the violated constraint (algorithm 1)."""
        b, C, E, J = state.b, state.C, state.E, None
        if self.neighbours is not None:
            J = ((state.Y3.b / b) * state.Y3.J + E).tocsr()
            E = (E @ self.neighbours.D.T).tocsr()
        dense = {name: gap for name, gap in gaps.items() if name != "code"}
        return replace(super().multiplier_step(state, dense), Y3=Multiplier(C.V, C.M, (C.fixed - E).tocsr(), J, b))

    def operations(self, state: State) -> float:
        """Multiplications and additions of the iteration that led to a state, without lower orders."""
        P, rank = state.S.shape[2], len(state.C.V)
        rows, F = 3 * len(state.S) + 1, len(state.S)
        code = 2.0 * rows**2 * P + 4.0 * rank * rows * P
        stream = 2.0 * rank * P * P + 3.0 * P * P
        return float(code + stream + state.C.operations + 12.0 * F * F * P)

    def _map(self, work: Callable[[slice], Any], width: int) -> Iterator[Any]:
        """``work`` on blocks of rows, on as many threads as BLAS may use, one BLAS thread each."""
        P = self.W.shape[2]
        height = max(1, min(P, BLOCK_BYTES // (width * np.dtype(self.dtype).itemsize)))
        blocks = [slice(i, min(i + height, P)) for i in range(0, P, height)]
        threads = min(blas_threads(), len(blocks))
        if threads == 1:
            yield from map(work, blocks)
        else:
            with _controller().limit(limits=1, user_api="blas"), ThreadPoolExecutor(threads) as pool:
                yield from pool.map(work, blocks)


_controller = cache(ThreadpoolController)


def blas_threads() -> int:
    """Threads that BLAS may use."""
    return max((pool.num_threads for pool in _controller().lib_controllers if pool.user_api == "blas"), default=1)


def _leading(rows: Array, tol: float) -> tuple[Array, Array]:
    """Orthonormal Q (m, k) with |rows - Q Q'rows| <= tol |rows|, and the squares of the singular values kept.

    By the m x m Gram matrix, whose rounding hides singular values under 1e-8 of the largest: a smaller tol keeps all.
    """
    k, Q = scipy.linalg.eigh(rows @ rows.T, check_finite=False)
    k = np.maximum(k, 0)
    start = int(np.searchsorted(np.cumsum(k), tol**2 * k.sum(), side="right")) if tol > 1e-8 else 0
    return Q[:, start:], k[start:]


def implicit_bytes(n_frames: int, n_points: int, n_edges: int, size: int) -> float:
    """Peak memory of the implicit iteration in bytes, for numbers of ``size`` bytes.

    As many 3F x P arrays as measured, a hundred bytes and more for each entry of the sparse matrices, and the blocks.
    The number of entries of E is not known in advance; ENTRIES per track is not reached with a capped penalty.
    """
    width = 1 + n_edges / n_points
    arrays = (20 if size == 4 else 30) * 3 * n_frames * 8.0
    entries = ENTRIES * (100 + 4 * size) * width**2
    return n_points * (arrays + entries) + 8 * width * BLOCK_BYTES
