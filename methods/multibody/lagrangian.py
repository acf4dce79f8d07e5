"""The augmented Lagrangian of multi-body NRSfM as printed, and its exact block updates.

Kumar, Dai, Li, "Multi-body non-rigid structure-from-motion", 3DV 2016. Equation numbers below are of arXiv 1607.04515.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nrsfm.methods.base import Array
from nrsfm.methods.multibody.problem import Gaps, Problem, Square, State, solve_code
from nrsfm.methods.numerics.linear import axes, cholesky_solve, gram, shifted_cholesky, without_diagonal
from nrsfm.methods.numerics.proximal import soft


@dataclass(frozen=True)
class PrintedProblem(Problem):
    """The augmented Lagrangian of eq. (11) for sparse tracks, D = I, with C as an array; all constraints share b."""

    def start(self, b: float, S: Array | None = None) -> State:
        """S (by default pinv(R) W), S# = g(S), all else zero."""
        S = self.cameras.transpose(0, 2, 1) @ self.W if S is None else S
        P = S.shape[2]
        square, zero = np.zeros((P, P)), np.zeros_like(S)
        return State(S=S, shape=S, C=square, E=square, Y1=zero, Y2=zero, Y3=square, Y4=np.zeros(P), b=b)

    def code_rows(self, state: State) -> tuple[Array, Array]:
        """V = [S; 1'] and H = [S + Y2/b; 1' - Y4/b], (3F + 1, P)."""
        P = state.S.shape[2]
        V = np.concatenate([state.S.reshape(-1, P), np.ones((1, P))])
        multipliers = np.concatenate([state.Y2.reshape(-1, P), -state.Y4[None]])
        return V, V + multipliers / state.b

    def code_step(self, state: State) -> Square:
        """C of eq. (20) with D = I: (S'S + 11' + I) C = S'S + S'Y2/b + 11' - 1 Y4/b + E - Y3/b."""
        V, H = self.code_rows(state)
        return solve_code(V, H, state.E - state.Y3 / state.b, self.diagonal)

    def sparse_step(self, state: State) -> Square:
        """E of eq. (18): soft threshold of C + Y3/b at l1/b, its diagonal zero."""
        E = soft(state.C + state.Y3 / state.b, self.l1 / state.b)
        return without_diagonal(E) if self.diagonal == "threshold" else E

    def code_gap(self, state: State) -> Array:
        """C - E."""
        gap: Array = state.C - state.E
        return gap

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
        rhs[:, :2, :] += self.W / b
        B = gram(M.T)
        for rows, shift in ((slice(0, 2), 1 + 1 / b), (slice(2, 3), 1.0)):
            flat = rhs[:, rows, :].reshape(-1, P).T
            rhs[:, rows, :] = cholesky_solve(shifted_cholesky(B, shift), flat).T.reshape(F, -1, P)
        S: Array = Q.transpose(0, 2, 1) @ rhs
        return S

    def gaps(self, state: State) -> Gaps:
        """S# - g(S), S - S C, C D - E and 1'C - 1'."""
        return {
            "shape": state.shape - state.S,
            "expression": state.S - times(state.S, state.C),
            "code": self.code_gap(state),
            "affine": state.C.sum(axis=0) - 1,
        }

    def objective(self, state: State) -> float:
        """1/2 |W - R S|^2 + l1 |E|_1 + l2 |S#|_*."""
        fit = self.W - self.cameras @ state.S
        return 0.5 * float(np.sum(fit**2)) + self.l1 * float(abs(state.E).sum()) + self.l2 * state.nuclear_norm

    def operations(self, state: State) -> float:
        """Multiplications and additions of an iteration, without lower orders.

        Two products of r x P and P x P and the factor of the smaller side for C; a symmetric product, two factors and
        three products of 3F x P and P x P for S; one more for S C.
        """
        F, _, P = state.S.shape
        r = 3 * F + 1
        small = min(r, P)
        code = r * P * small + small**3 / 3 + 2.0 * P * P * (2 * small if r < P else r + P)
        structure = P**3 + 2 * P**3 / 3 + 2.0 * 3 * F * P * P * 3
        return float(code + structure + 2.0 * 3 * F * P * P + 12.0 * F * F * P)


def times(X: Array, M: Array) -> Array:
    """X M for (F, 3, P) trajectories and a (P, P) matrix, as one product of 3F rows."""
    product: Array = (X.reshape(-1, X.shape[2]) @ M).reshape(X.shape)
    return product


def dense_bytes(n_frames: int, n_points: int, n_edges: int = 0) -> float:
    """Peak memory of the dense iteration in bytes: arrays of P x P, P x edges and 3F x P, as many as measured."""
    return 8.0 * n_points * (11 * n_points + 8 * n_edges + 20 * 3 * n_frames)
