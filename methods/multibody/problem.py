"""The ADMM that both formulations of multi-body NRSfM share: variables, the steps a problem must have, and the loop."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self, TypeVar

import numpy as np

from nrsfm.methods.base import Array, Mask, Progress
from nrsfm.methods.gaps import fill
from nrsfm.methods.numerics.admm import Admm
from nrsfm.methods.numerics.proximal import singular_value_threshold

#: (P, P): an array, or its sparse and low-rank form in :mod:`nrsfm.methods.multibody.implicit`.
Square = Any
Gaps = Mapping[str, Array]


@dataclass(frozen=True, kw_only=True)
class State:
    """Variables of the ADMM: S, S# and Y1 are (F, 3, P), C, E and Y3 (P, P); b is the penalty of S# = g(S).

    The paper's g(S), the F x 3P arrangement, is a reshape of the (F, 3, P) array: no data moves. Y1 belongs to
    S# = g(S), Y3 to C = E.
    """

    S: Array
    shape: Array
    C: Square
    E: Square
    Y1: Array
    Y3: Square
    b: float
    nuclear_norm: float = 0.0


StateT = TypeVar("StateT", bound=State)


class Problem(Protocol[StateT]):
    """An augmented Lagrangian and the exact minimiser of each block of its variables."""

    @property
    def W(self) -> Array:
        """Centred tracks, (F, 2, P)."""

    @property
    def cameras(self) -> Array:
        """(F, 2, 3)."""

    @property
    def l2(self) -> float:
        """Weight of the nuclear norm."""

    def with_tracks(self, W: Array) -> Self:
        """The same problem with other tracks; whatever was derived from the first ones stays."""

    def code_step(self, state: StateT) -> Square:
        """The minimiser C."""

    def sparse_step(self, state: StateT) -> Square:
        """The minimiser E."""

    def structure_step(self, state: StateT) -> Array:
        """The minimiser S."""

    def gaps(self, state: StateT) -> Gaps:
        """Violation of each constraint; the infinity norms are the paper's residuals."""

    def multiplier_step(self, state: StateT, gaps: Gaps) -> StateT:
        """The state with each multiplier moved by its penalty times its gap."""

    def objective(self, state: StateT) -> float:
        """The objective without the constraints."""

    def penalties(self, state: StateT) -> tuple[tuple[Array, str, float], ...]:
        """Multiplier, name of the gap and penalty of each constraint."""

    def operations(self, state: StateT) -> float:
        """Multiplications and additions of the iteration that led to a state, without lower orders."""


def shape_step(l2: float, state: State) -> tuple[Array, float]:
    """S# of eq. (16): singular value threshold of g(S) - Y1/b at l2/b; the shape and its nuclear norm."""
    F, _, P = state.S.shape
    flat, norm = singular_value_threshold((state.S - state.Y1 / state.b).reshape(F, 3 * P), l2 / state.b)
    return flat.reshape(F, 3, P), norm


def iterate(problem: Problem[StateT], state: StateT) -> tuple[StateT, Gaps]:
    """One iteration: C and E before S, so that S never meets an empty code; then S# and the multipliers.

    Returns the new state and the gaps of the constraints.
    """
    state = replace(state, C=problem.code_step(state))
    state = replace(state, E=problem.sparse_step(state))
    state = replace(state, S=problem.structure_step(state))
    shape, norm = shape_step(problem.l2, state)
    state = replace(state, shape=shape, nuclear_norm=norm)
    gaps = problem.gaps(state)
    return problem.multiplier_step(state, gaps), gaps


def minimise(
    problem: Problem[StateT],
    state: StateT,
    max_iter: int,
    tol: float,
    *,
    growth: float = 1.0,
    max_penalty: float = float("inf"),
    visible: Mask | None = None,
    progress: Progress | None = None,
) -> tuple[StateT, dict[str, Array]]:
    """Algorithm 1: iterate until all gaps' infinity norms are below ``tol``; b grows after each iteration.

    Where tracks have gaps, hidden entries of W are one more block of variables: in every iteration they take the values
    R S + t 1' that minimise the objective (:func:`nrsfm.methods.gaps.fill`). In the end their residual is zero, so the
    data term is that of the visible tracks.

    Returns
    -------
    State, dict of str to (T,) array
        The last state, and curves by iteration: the objective, the gaps' norms, CPU seconds and operations.
    """
    history: dict[str, list[float]] = defaultdict(list)
    admm = Admm(max_iter, tol, state.b, growth=growth, max_penalty=max_penalty, progress=progress)
    for b in admm:
        start = time.process_time()
        state, gaps = iterate(problem, replace(state, b=b))
        if visible is not None:
            problem = problem.with_tracks(fill(problem.W, problem.cameras @ state.S, visible))
        history["seconds"].append(time.process_time() - start)
        history["operations"].append(problem.operations(state))
        history["objective"].append(problem.objective(state))
        residuals = {name: float(np.abs(gap).max()) for name, gap in gaps.items()}
        for name, value in residuals.items():
            history[name].append(value)
        admm.report(**residuals)
    return state, {name: np.array(values) for name, values in history.items()}


def lagrangian(problem: Problem[StateT], state: StateT) -> float:
    """The augmented Lagrangian whose blocks the steps minimise; for checks, as it costs a decomposition."""
    F, _, P = state.S.shape
    norm = float(np.linalg.svd(state.shape.reshape(F, 3 * P), compute_uv=False).sum())
    value = problem.objective(replace(state, nuclear_norm=norm))
    gaps = problem.gaps(state)
    for Y, name, b in problem.penalties(state):
        value += float(np.sum(Y * gaps[name])) + b / 2 * float(np.sum(gaps[name] ** 2))
    return value
