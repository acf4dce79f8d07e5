"""The ADMM that both formulations of multi-body NRSfM share: variables, the steps of a problem, and the loop."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from nrsfm.methods.base import Array, Mask
from nrsfm.methods.gaps import fill
from nrsfm.methods.numerics.admm import Admm
from nrsfm.methods.numerics.linear import cholesky_solve, gram, shifted_cholesky, without_diagonal
from nrsfm.methods.numerics.proximal import singular_value_threshold

#: (P, P): an array, or its sparse and low-rank form in :mod:`nrsfm.methods.multibody.implicit`.
Square = Any
Gaps = Mapping[str, Array]
#: The multiplier of each constraint, by the name of its gap.
MULTIPLIERS = {"shape": "Y1", "expression": "Y2", "code": "Y3", "affine": "Y4", "images": "Y5"}
#: Ways to keep diag(C) = 0, see :class:`nrsfm.methods.multibody.printed.MultiBody`.
DIAGONALS = ("threshold", "exact", "paper")


@dataclass(frozen=True, kw_only=True)
class State:
    """Variables of the ADMM. The paper's g(S), the F x 3P arrangement, is a reshape of S: no data moves."""

    S: Array  # (F, 3, P)
    shape: Array  # S#, (F, 3, P)
    C: Square
    E: Square
    Y1: Array  # multiplier of S# = g(S), (F, 3, P)
    Y2: Any = None  # of S = S C, (F, 3, P); None in a formulation without it
    Y3: Square  # of C = E
    Y4: Any = None  # of 1'C = 1', (P,); None in a formulation without it
    U: Any = None  # images, (F, 2, P); None in a formulation without them
    Y5: Any = None  # of U = R S, (F, 2, P)
    b: float  # the penalty of S# = g(S)
    nuclear_norm: float = 0.0


@dataclass(frozen=True)
class Problem:
    """An augmented Lagrangian and the exact minimiser of each block of its variables."""

    W: Array  # centred tracks, (F, 2, P)
    cameras: Array  # (F, 2, 3)
    l1: float  # weight of |E|_1
    l2: float  # weight of |S#|_*
    diagonal: str = field(default="threshold", kw_only=True)  # one of DIAGONALS

    @abstractmethod
    def code_step(self, state: State) -> Square:
        """The minimiser C."""

    @abstractmethod
    def sparse_step(self, state: State) -> Square:
        """The minimiser E."""

    @abstractmethod
    def structure_step(self, state: State) -> Array:
        """The minimiser S."""

    @abstractmethod
    def gaps(self, state: State) -> Gaps:
        """Violation of each constraint; the infinity norms are the paper's residuals."""

    @abstractmethod
    def objective(self, state: State) -> float:
        """The objective without the constraints."""

    @abstractmethod
    def operations(self, state: State) -> float:
        """Multiplications and additions of the iteration that led to a state, without lower orders."""

    def update(self, state: State) -> State:
        """All steps but the multipliers'. C and E come before S, so that S never meets an empty code."""
        state = replace(state, C=self.code_step(state))
        state = replace(state, E=self.sparse_step(state))
        state = replace(state, S=self.structure_step(state))
        shape, norm = self.shape_step(state)
        return replace(state, shape=shape, nuclear_norm=norm)

    def shape_step(self, state: State) -> tuple[Array, float]:
        """The minimiser S# and its nuclear norm, eq. (16): singular value threshold of g(S) - Y1/b at l2/b."""
        F, _, P = state.S.shape
        shifted = self.ordered(state.S) - state.Y1 / state.b
        flat, norm = singular_value_threshold(shifted.reshape(F, 3 * P), self.l2 / state.b)
        return flat.reshape(F, 3, P), norm

    def ordered(self, S: Array) -> Array:
        """The (F, 3, P) array of S whose nuclear norm is taken: S itself."""
        return S

    def images(self, state: State) -> Array:
        """What the data term compares the tracks with, (F, 2, P): R S."""
        return self.cameras @ state.S

    def penalty(self, state: State, name: str) -> float:
        """The penalty of a constraint, by the name of its gap."""
        return state.b

    def multiplier_step(self, state: State, gaps: Gaps) -> State:
        """Y += its penalty times the violated constraint (algorithm 1)."""
        names = {name: Y for name, Y in MULTIPLIERS.items() if name in gaps}
        return replace(
            state, **{Y: getattr(state, Y) + self.penalty(state, name) * gaps[name] for name, Y in names.items()}
        )


def solve_code(V: Array, H: Array, N: Array, diagonal: str) -> Array:
    """C of (V'V + I) C = V'H + N for V, H (r, P) and N (P, P): a ridge regression of the tracks on each other.

    The smaller of two matrices is factored, V'V + I or V V' + I: with C = N + V'T, (V V' + I) T = H - V N.
    O(r P min(r, P) + r P^2). The diagonal: ``exact`` solves under diag(C) = 0, ``paper`` subtracts the diagonal of the
    solution, ``threshold`` leaves it.
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


def iterate(problem: Problem, state: State) -> tuple[State, Gaps]:
    """The next state and its gaps."""
    state = problem.update(state)
    gaps = problem.gaps(state)
    return problem.multiplier_step(state, gaps), gaps


def minimise(problem: Problem, state: State, admm: Admm, visible: Mask | None) -> tuple[State, dict[str, Array]]:
    """Algorithm 1: iterate until the infinity norms of all gaps are below the tolerance.

    Where tracks have gaps, hidden entries of W are one more block of variables: in every iteration they take the values
    images + t 1' that minimise the objective (:func:`nrsfm.methods.gaps.fill`). In the end their residual is zero, so
    the data term is that of the visible tracks. Whatever a problem derived from the first tracks stays.

    Returns
    -------
    State, dict of str to (T,) array
        The last state, and curves by iteration: the objective, the gaps' norms, CPU seconds and operations.
    """
    history: dict[str, list[float]] = defaultdict(list)
    for b in admm:
        start = time.process_time()
        state, gaps = iterate(problem, replace(state, b=b))
        if visible is not None:
            problem = replace(problem, W=fill(problem.W, problem.images(state), visible))
        history["seconds"].append(time.process_time() - start)
        history["operations"].append(problem.operations(state))
        history["objective"].append(problem.objective(state))
        residuals = {name: float(np.abs(gap).max()) for name, gap in gaps.items()}
        for name, value in residuals.items():
            history[name].append(value)
        admm.report(**residuals)
    return state, {name: np.array(values) for name, values in history.items()}
