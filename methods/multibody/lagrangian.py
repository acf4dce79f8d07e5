"""The augmented Lagrangian of multi-body NRSfM as printed, and its exact block updates.

Kumar, Dai, Li, "Multi-body non-rigid structure-from-motion", 3DV 2016. Equation numbers below are of arXiv 1607.04515.
"""

from __future__ import annotations

import copy
import time
from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from nrsfm.methods.base import Array, Mask, Progress
from nrsfm.methods.gaps import fill
from nrsfm.methods.numerics.backend import (
    absolute_sum,
    cholesky_solve,
    gram,
    identity,
    largest,
    namespace,
    shifted_cholesky,
    without_diagonal,
    zeros,
)
from nrsfm.methods.numerics.cameras import axes
from nrsfm.methods.numerics.proximal import singular_value_threshold, soft

#: (P, P): an array, or what :mod:`nrsfm.methods.multibody.implicit` keeps in its place.
Square = Any


RESIDUALS = ("shape", "expression", "code", "affine")


@dataclass(frozen=True)
class State:
    """Variables of the ADMM: S, S# and Y1 are (F, 3, P), C, E and Y3 (P, P), Y2 (F, 3, P), Y4 (P,); penalty b.

    The paper's g(S), the F x 3P arrangement, is a reshape of the (F, 3, P) array: no data moves.
    """

    S: Array
    shape: Array
    C: Square
    E: Square
    Y1: Array
    Y2: Array
    Y3: Square
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
        S = namespace(self.W).matrix_transpose(self.cameras) @ self.W
        P = S.shape[2]
        square, zero = zeros((P, P), S), zeros(S.shape, S)
        return State(S, S, square, square, zero, zero, square, zeros((P,), S), b)

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

    def code_step(self, state: State) -> Square:
        """C of eq. (20) with D = I: (S'S + 11' + I) C = S'S + S'Y2/b + 11' - 1 Y4/b + E - Y3/b."""
        V, H = self.code_rows(state)
        return self.solve_code(V, H, state.E - state.Y3 / state.b)

    def code_rows(self, state: State) -> tuple[Array, Array]:
        """V = [S; 1'] and H = [S + Y2/b; 1' - Y4/b], (3F + 1, P)."""
        xp, P = namespace(state.S), state.S.shape[2]
        V = xp.concat([xp.reshape(state.S, (-1, P)), zeros((1, P), state.S) + 1])
        multipliers = xp.concat([xp.reshape(state.Y2, (-1, P)), -xp.reshape(state.Y4, (1, P))])
        return V, V + multipliers / state.b

    def solve_code(self, V: Array, H: Array, N: Array) -> Array:
        """C of (V'V + I) C = V'H + N for V, H (r, P) and N (P, P), its diagonal as ``diagonal`` demands.

        The smaller of two matrices is factored, V'V + I or V V' + I: with C = N + V'T, (V V' + I) T = H - V N.
        O(r P min(r, P) + r P^2).
        """
        xp, (r, P) = namespace(V), V.shape
        if r < P:
            factor = shifted_cholesky(gram(V.T), 1.0)
            C = N + V.T @ cholesky_solve(factor, H - V @ N)
        else:
            factor = shifted_cholesky(gram(V), 1.0)
            C = cholesky_solve(factor, V.T @ H + N)
        if self.diagonal == "exact":  # multipliers m of diag(C) = 0: C = K^-1 (rhs - diag(m)), K = V'V + I
            whole = identity(P, V)
            inverse = whole - V.T @ cholesky_solve(factor, V * 1) if r < P else cholesky_solve(factor, whole)
            C = C - inverse * (xp.linalg.diagonal(C) / xp.linalg.diagonal(inverse))
        return without_diagonal(C) if self.diagonal == "paper" else C

    def sparse_step(self, state: State) -> Square:
        """E of eq. (18): soft threshold of C + Y3/b at l1/b, its diagonal zero."""
        E = soft(state.C + state.Y3 / state.b, self.l1 / state.b)
        return without_diagonal(E) if self.diagonal == "threshold" else E

    def structure_step(self, state: State) -> Array:
        """S of eq. (14), without a Sylvester solver.

        In each frame's own axes R'R = diag(1, 1, 0), so rows decouple: with B = (I - C)(I - C)', image rows solve
        X (B + (1 + 1/b) I) = rhs and depth rows X (B + I) = rhs. Two P x P Cholesky factorisations, O(3F P^2 + P^3).
        """
        xp, b = namespace(state.S), state.b
        F, _, P = state.S.shape
        M = identity(P, state.S) - state.C
        Q = axes(self.cameras)
        rhs = Q @ (state.shape + (state.Y1 - times(state.Y2, M.T)) / b)
        rhs[:, :2, :] += self.W / b
        B = gram(M.T)
        for rows, shift in ((slice(0, 2), 1 + 1 / b), (slice(2, 3), 1.0)):
            flat = xp.reshape(rhs[:, rows, :], (-1, P)).T
            rhs[:, rows, :] = xp.reshape(cholesky_solve(shifted_cholesky(B, shift), flat).T, (F, -1, P))
        return xp.matrix_transpose(Q) @ rhs

    def shape_step(self, state: State) -> tuple[Array, float]:
        """S# of eq. (16): singular value threshold of g(S) - Y1/b at l2/b; the shape and its nuclear norm."""
        F, _, P = state.S.shape
        xp = namespace(state.S)
        flat = xp.reshape(state.S - state.Y1 / state.b, (F, 3 * P))
        flat, norm = singular_value_threshold(flat, self.l2 / state.b)
        return xp.reshape(flat, (F, 3, P)), norm

    def gaps(self, state: State) -> dict[str, Array]:
        """S# - g(S), S - S C, C - E and 1'C - 1'."""
        values = (
            state.shape - state.S,
            state.S - times(state.S, state.C),
            self.code_gap(state),
            namespace(state.C).sum(state.C, axis=0) - 1,
        )
        return dict(zip(RESIDUALS, values, strict=True))

    def code_gap(self, state: State) -> Square:
        """C - E."""
        return state.C - state.E

    def multiplier_step(self, state: State, gaps: dict[str, Array]) -> State:
        """Y += b times the violated constraint (algorithm 1)."""
        Y = (state.Y1, state.Y2, state.Y3, state.Y4)
        Y1, Y2, Y3, Y4 = (y + state.b * gap for y, gap in zip(Y, gaps.values(), strict=True))
        return replace(state, Y1=Y1, Y2=Y2, Y3=Y3, Y4=Y4)

    def objective(self, state: State) -> float:
        """1/2 |W - R S|^2 + l1 |E|_1 + l2 |S#|_*."""
        fit = self.W - self.cameras @ state.S
        square = float(namespace(fit).sum(fit**2))
        return 0.5 * square + self.l1 * absolute_sum(state.E) + self.l2 * state.nuclear_norm

    def operations(self, state: State) -> float:
        """Multiplications and additions of an iteration, its lower orders left out.

        Two products of r x P and P x P and the factor of the smaller side for C; a symmetric product, two factors and
        three products of 3F x P and P x P for S; one more for S C.
        """
        F, _, P = state.S.shape
        r = 3 * F + 1
        small = min(r, P)
        code = r * P * small + small**3 / 3 + 2.0 * P * P * (2 * small if r < P else r + P)
        structure = P**3 + 2 * P**3 / 3 + 2.0 * 3 * F * P * P * 3
        return code + structure + 2.0 * 3 * F * P * P + 12.0 * F * F * P

    def lagrangian(self, state: State) -> float:
        """The augmented Lagrangian whose blocks the steps minimise; for checks, as it costs a decomposition."""
        xp, (F, _, P) = namespace(state.S), state.S.shape
        flat = xp.reshape(state.shape, (F, 3 * P))
        value = self.objective(replace(state, nuclear_norm=float(xp.sum(xp.linalg.svdvals(flat)))))
        gaps = self.gaps(state)
        for Y, name, b in self.penalties(state):
            value += float(xp.sum(Y * gaps[name])) + b / 2 * float(xp.sum(gaps[name] ** 2))
        return value

    def penalties(self, state: State) -> tuple[tuple[Array, str, float], ...]:
        """Multiplier, the name of its gap and its penalty, of each constraint."""
        Y = (state.Y1, state.Y2, state.Y3, state.Y4)
        return tuple((y, name, state.b) for y, name in zip(Y, RESIDUALS, strict=True))


def minimise(
    problem: Problem,
    state: State,
    max_iter: int,
    tol: float,
    *,
    growth: float = 1.0,
    max_penalty: float = float("inf"),
    visible: Mask | None = None,
    progress: Progress | None = None,
) -> tuple[State, dict[str, Array]]:
    """Algorithm 1: iterate until all gaps' infinity norms are below ``tol``; b grows after each iteration.

    Where tracks have gaps, hidden entries of W are one more block of variables: in every iteration they take the values
    R S + t 1' that minimise the objective (:func:`nrsfm.methods.gaps.fill`). At the end of it all their residual is zero, so
    that the data term is that of the visible tracks.

    Returns the last state and curves by iteration: the objective, the gaps' norms, CPU seconds and operations.
    """
    history: dict[str, list[float]] = defaultdict(list)
    for iteration in range(1, max_iter + 1):
        start = time.process_time()
        state, gaps = problem.iterate(state)
        if visible is not None:
            problem = problem.at(fill(problem.W, problem.cameras @ state.S, visible))
        history["seconds"].append(time.process_time() - start)
        history["operations"].append(problem.operations(state))
        residuals = {name: largest(gap) for name, gap in gaps.items()}
        history["objective"].append(problem.objective(state))
        for name, value in residuals.items():
            history[name].append(value)
        if progress is not None:
            progress(iteration, max_iter, residuals)
        if max(residuals.values()) < tol:
            break
        state = replace(state, b=min(max_penalty, growth * state.b))
    return state, {name: np.array(values) for name, values in history.items()}


def times(X: Array, M: Array) -> Array:
    """X M for (F, 3, P) trajectories and a (P, P) matrix, as one product of 3F rows."""
    xp = namespace(X)
    return xp.reshape(xp.reshape(X, (-1, X.shape[2])) @ M, X.shape)


def dense_bytes(n_frames: int, n_points: int, n_edges: int = 0) -> float:
    """Bytes that the dense iteration takes at its peak: arrays of P x P, P x edges and 3F x P, as many as measured."""
    return 8.0 * n_points * (11 * n_points + 8 * n_edges + 20 * 3 * n_frames)
