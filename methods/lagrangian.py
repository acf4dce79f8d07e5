"""The augmented Lagrangian of multi-body NRSfM as printed, and its exact block updates.

Kumar, Dai, Li, "Multi-body non-rigid structure-from-motion", 3DV 2016. Equation numbers below are of arXiv 1607.04515.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg

from methods.base import Array
from methods.cameras import axes
from methods.proximal import singular_value_threshold, soft

RESIDUALS = ("shape", "expression", "code", "affine")


@dataclass(frozen=True)
class State:
    """Variables of the ADMM: S, S# and Y1 are (F, 3, P), C, E and Y3 (P, P), Y2 (F, 3, P), Y4 (P,); penalty b.

    The paper's g(S), the F x 3P arrangement, is a reshape of the (F, 3, P) array: no data moves.
    """

    S: Array
    shape: Array
    C: Array
    E: Array
    Y1: Array
    Y2: Array
    Y3: Array
    Y4: Array
    b: float
    nuclear_norm: float = field(default=0.0)


@dataclass(frozen=True)
class Problem:
    """The augmented Lagrangian of eq. (11) and its exact block updates, for centred tracks W (F, 2, P)."""

    W: Array
    cameras: Array
    l1: float
    l2: float
    diagonal: str = "threshold"

    def at(self, W: Array) -> Problem:
        """The same problem with other tracks; whatever was derived from the first ones stays."""
        other = copy.copy(self)
        object.__setattr__(other, "W", W)
        return other

    def start(self, b: float) -> State:
        """S = pinv(R) W, S# = g(S), all else zero."""
        S = self.cameras.transpose(0, 2, 1) @ self.W
        P = S.shape[2]
        square = np.zeros((P, P))
        zero = np.zeros_like(S)
        return State(S, S, square, square, zero, zero, square, np.zeros(P), b)

    def iterate(self, state: State) -> tuple[State, dict[str, Array]]:
        """One sweep: C and E before S, so that S never meets an empty code; then S# and the multipliers.

        Returns the new state and the constraints' gaps, whose infinity norms are the paper's residuals.
        """
        state = replace(state, C=self.code_step(state))
        state = replace(state, E=self.sparse_step(state))
        state = replace(state, S=self.structure_step(state))
        shape, norm = self.shape_step(state)
        state = replace(state, shape=shape, nuclear_norm=norm)
        gaps = self.gaps(state)
        return self.multiplier_step(state, gaps), gaps

    def code_step(self, state: State) -> Array:
        """C of eq. (20) with D = I: (S'S + 11' + I) C = S'S + S'Y2/b + 11' - 1 Y4/b + E - Y3/b."""
        P, b = state.C.shape[0], state.b
        V = np.concatenate([state.S.reshape(-1, P), np.ones((1, P))])
        H = V + np.concatenate([state.Y2.reshape(-1, P), -state.Y4[None]]) / b
        return self.solve_code(V, H, state.E - state.Y3 / b)

    def solve_code(self, V: Array, H: Array, N: Array) -> Array:
        """C of (V'V + I) C = V'H + N for V, H (r, P) and N (P, P), its diagonal as ``diagonal`` demands.

        The smaller of two matrices is factored, V'V + I or V V' + I: with C = N + V'T, (V V' + I) T = H - V N.
        O(r P min(r, P) + r P^2).
        """
        P = len(N)
        if len(V) < P:
            factor = shifted_cholesky(gram(V.T), 1.0)
            C = N + V.T @ scipy.linalg.cho_solve(factor, H - V @ N, overwrite_b=True, check_finite=False)
        else:
            factor = shifted_cholesky(gram(V), 1.0)
            C = scipy.linalg.cho_solve(factor, V.T @ H + N, overwrite_b=True, check_finite=False)
        if self.diagonal == "exact":  # multipliers m of diag(C) = 0: C = K^-1 (rhs - diag(m)), K = V'V + I
            if len(V) < P:
                inverse = np.eye(P) - V.T @ scipy.linalg.cho_solve(factor, V, check_finite=False)
            else:
                inverse = scipy.linalg.cho_solve(factor, np.eye(P), check_finite=False)
            C -= inverse * (np.diag(C) / np.diag(inverse))
        if self.diagonal == "paper":
            np.fill_diagonal(C, 0)
        return C

    def sparse_step(self, state: State) -> Array:
        """E of eq. (18): soft threshold of C + Y3/b at l1/b, its diagonal zero."""
        E = soft(state.C + state.Y3 / state.b, self.l1 / state.b)
        if self.diagonal == "threshold":
            np.fill_diagonal(E, 0)
        return E

    def structure_step(self, state: State) -> Array:
        """S of eq. (14), without a Sylvester solver.

        In each frame's own axes R'R = diag(1, 1, 0), so rows decouple: with B = (I - C)(I - C)', image rows solve
        X (B + (1 + 1/b) I) = rhs and depth rows X (B + I) = rhs. Two P x P Cholesky factorisations, O(3F P^2 + P^3).
        """
        b = state.b
        F, _, P = state.S.shape
        M = np.eye(P) - state.C
        Q = axes(self.cameras)
        rhs = Q @ (state.shape + (state.Y1 - times(state.Y2, M.T)) / b)
        rhs[:, :2] += self.W / b
        B = gram(M.T)
        for rows, shift in ((slice(0, 2), 1 + 1 / b), (slice(2, 3), 1.0)):
            factor = shifted_cholesky(B, shift)
            flat = rhs[:, rows].reshape(-1, P).T
            rhs[:, rows] = scipy.linalg.cho_solve(factor, flat, check_finite=False).T.reshape(F, -1, P)
        return Q.transpose(0, 2, 1) @ rhs

    def shape_step(self, state: State) -> tuple[Array, float]:
        """S# of eq. (16): singular value threshold of g(S) - Y1/b at l2/b; the shape and its nuclear norm."""
        F, _, P = state.S.shape
        flat, norm = singular_value_threshold((state.S - state.Y1 / state.b).reshape(F, 3 * P), self.l2 / state.b)
        return flat.reshape(F, 3, P), norm

    def gaps(self, state: State) -> dict[str, Array]:
        """S# - g(S), S - S C, C - E and 1'C - 1'."""
        values = (
            state.shape - state.S,
            state.S - times(state.S, state.C),
            state.C - state.E,
            state.C.sum(axis=0) - 1,
        )
        return dict(zip(RESIDUALS, values, strict=True))

    def multiplier_step(self, state: State, gaps: dict[str, Array]) -> State:
        """Y += b times the violated constraint (algorithm 1)."""
        Y = (state.Y1, state.Y2, state.Y3, state.Y4)
        Y1, Y2, Y3, Y4 = (y + state.b * gap for y, gap in zip(Y, gaps.values(), strict=True))
        return replace(state, Y1=Y1, Y2=Y2, Y3=Y3, Y4=Y4)

    def objective(self, state: State) -> float:
        """1/2 |W - R S|^2 + l1 |E|_1 + l2 |S#|_*."""
        fit = self.W - self.cameras @ state.S
        return float(0.5 * np.sum(fit**2) + self.l1 * np.abs(state.E).sum() + self.l2 * state.nuclear_norm)

    def lagrangian(self, state: State) -> float:
        """The augmented Lagrangian whose blocks the steps minimise; for checks, as it costs a decomposition."""
        F, _, P = state.S.shape
        fit = self.W - self.cameras @ state.S
        nuclear = np.linalg.norm(state.shape.reshape(F, 3 * P), "nuc")
        value = 0.5 * np.sum(fit**2) + self.l1 * np.abs(state.E).sum() + self.l2 * nuclear
        for Y, gap in zip((state.Y1, state.Y2, state.Y3, state.Y4), self.gaps(state).values(), strict=True):
            value += np.sum(Y * gap) + state.b / 2 * np.sum(gap**2)
        return float(value)


def times(X: Array, M: Array) -> Array:
    """X M for (F, 3, P) trajectories and a (P, P) matrix, as one product of 3F rows."""
    return (X.reshape(-1, X.shape[2]) @ M).reshape(X.shape)


def gram(A: Array) -> Array:
    """The lower triangle of A'A for an (m, n) array, the rest zero: half the work of the product."""
    if A.flags.c_contiguous:  # A.T is in the order that BLAS wants, so nothing is copied
        return scipy.linalg.blas.dsyrk(1.0, A.T, lower=1)
    return scipy.linalg.blas.dsyrk(1.0, A, trans=1, lower=1)


def shifted_cholesky(A: Array, shift: float) -> tuple[Array, bool]:
    """Cholesky factor of A + shift I, of which the lower triangle is given; for ``scipy.linalg.cho_solve``."""
    A = A.copy(order="F")
    A[np.diag_indices(len(A))] += shift
    return scipy.linalg.cho_factor(A, lower=True, overwrite_a=True, check_finite=False)
