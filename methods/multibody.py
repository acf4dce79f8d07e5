"""Ours: multi-body non-rigid structure from motion, reconstruction and segmentation in one ADMM.

Kumar, Dai, Li, "Multi-body non-rigid structure-from-motion", 3DV 2016. Equation numbers below are of arXiv 1607.04515.

    min  1/2 |W - R S|^2 + l1 |E|_1 + l2 |S#|_*
    s.t. S# = g(S),  S = S C,  C = E,  1'C = 1',  diag(C) = 0
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from methods.base import (
    Array,
    Method,
    MethodError,
    Progress,
    Reconstruction,
    check_bodies,
    check_cameras,
    standardise,
)
from methods.cameras import axes
from methods.proximal import singular_value_threshold, soft
from methods.spectral import spectral_clustering

DIAGONALS = ("threshold", "exact", "paper")
RESIDUALS = ("shape", "expression", "code", "affine")


class MultiBody(Method):
    """The paper's method for sparse tracks (D = I).

    Parameters
    ----------
    l1, l2 : float
        Weights of |E|_1 and of |S#|_*, in standardised units.
    penalty, growth, max_penalty : float
        The penalty b of the augmented Lagrangian: its start, its factor per iteration and its cap.
    max_iter : int
    tol : float
        Stop when the four residuals' infinity norms are below it (the paper's epsilon).
    diagonal : {"threshold", "exact", "paper"}
        How diag(C) = 0 is kept. ``threshold``: by the E-step, an exact proximal step. ``exact``: by the C-step,
        solved under the constraint. ``paper``: C - diag(C) after the C-step, as printed, which breaks the
        minimisation.
    seed : int
        Of k-means.
    """

    provides = frozenset({"labels", "structure"})

    def __init__(
        self,
        *,
        l1: float = 3e-3,
        l2: float = 0.1,
        penalty: float = 1e-3,
        growth: float = 1.1,
        max_penalty: float = 1e3,
        max_iter: int = 250,
        tol: float = 1e-8,
        diagonal: str = "threshold",
        seed: int = 0,
    ) -> None:
        self.l1 = l1
        self.l2 = l2
        self.penalty = penalty
        self.growth = growth
        self.max_penalty = max_penalty
        self.max_iter = max_iter
        self.tol = tol
        self.diagonal = diagonal
        self.seed = seed

    def reconstruct(
        self,
        tracks: Array,
        cameras: Array,
        n_bodies: int,
        *,
        edges: NDArray[np.int64] | None = None,
        progress: Progress | None = None,
    ) -> Reconstruction:
        """See :meth:`methods.base.Method.reconstruct`."""
        data = standardise(tracks)
        check_cameras(cameras, len(tracks))
        check_bodies(n_bodies, tracks.shape[2])
        self._check_settings()
        problem = Problem(data.W, cameras, self.l1, self.l2, self.diagonal)
        state = problem.start(self.penalty)
        history: dict[str, list[float]] = {name: [] for name in ("objective", *RESIDUALS)}
        for iteration in range(1, self.max_iter + 1):
            state, gaps = problem.iterate(state)
            residuals = {name: float(np.abs(gap).max()) for name, gap in gaps.items()}
            history["objective"].append(problem.objective(state))
            for name, value in residuals.items():
                history[name].append(value)
            if progress is not None:
                progress(iteration, self.max_iter, residuals)
            if max(residuals.values()) < self.tol:
                break
            state = replace(state, b=min(self.max_penalty, self.growth * state.b))
        affinity = np.abs(state.E) + np.abs(state.E.T)
        return Reconstruction(
            labels=spectral_clustering(affinity, n_bodies, seed=self.seed),
            structure=state.S * data.scale,
            cameras=cameras,
            affinity=affinity,
            history={name: np.array(values) for name, values in history.items()},
        )

    def _check_settings(self) -> None:
        if self.diagonal not in DIAGONALS:
            raise MethodError(f"method.diagonal is {self.diagonal!r}, wanted one of {', '.join(DIAGONALS)}")
        for name in ("l1", "l2", "penalty", "max_penalty"):
            if not getattr(self, name) > 0:
                raise MethodError(f"method.{name} is {getattr(self, name)}, wanted a positive number")
        if not self.growth >= 1:
            raise MethodError(f"method.growth is {self.growth}, wanted at least 1")
        if self.max_iter < 1:
            raise MethodError(f"method.max_iter is {self.max_iter}, wanted at least 1")


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
        """C of eq. (20) with D = I: (S'S + 11' + I) C = S'S + S'Y2/b + 11' - 1 Y4/b + E - Y3/b.

        With V = [S; 1'] (r x P), H = [S + Y2/b; 1' - Y4/b] and N = E - Y3/b it reads (V'V + I) C = V'H + N. The smaller
        of two matrices is factored, V'V + I or V V' + I: with C = N + V'T, (V V' + I) T = H - V N.
        O(r P min(r, P) + r P^2).
        """
        P, b = state.C.shape[0], state.b
        V = np.concatenate([state.S.reshape(-1, P), np.ones((1, P))])
        H = V + np.concatenate([state.Y2.reshape(-1, P), -state.Y4[None]]) / b
        N = state.E - state.Y3 / b
        if len(V) < P:
            factor = shifted_cholesky(gram(V.T), 1.0)
            C = N + V.T @ scipy.linalg.cho_solve(factor, H - V @ N, overwrite_b=True, check_finite=False)
        else:
            factor = shifted_cholesky(gram(V), 1.0)
            C = scipy.linalg.cho_solve(factor, V.T @ H + N, overwrite_b=True, check_finite=False)
        if self.diagonal == "exact":  # Lagrange multipliers m of diag(C) = 0: C = K^-1 (rhs - diag(m)), K = V'V + I
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
