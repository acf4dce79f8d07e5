"""One iteration of the printed formulation as sparse plus low-rank matrices, against the dense ADMM.

Both start from the same iterate in the middle of a solve, where the code is as dense as it gets.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from nrsfm.datasets.generated import procedural
from nrsfm.methods.base import standardise
from nrsfm.methods.multibody.implicit import ImplicitProblem
from nrsfm.methods.multibody.lagrangian import PrintedProblem
from nrsfm.methods.multibody.lowrank import Multiplier
from nrsfm.methods.multibody.problem import State, iterate
from tests.benchmarks.timing import timed
from tests.methods.parts import present

FRAMES = 99
FORMS: dict[str, dict[str, Any]] = {
    "implicit, double": {"dtype": np.float64, "cg_tol": 1e-13},
    "implicit, single": {"dtype": np.float32, "cg_tol": 1e-5},
}


@cache
def middle(P: int) -> tuple[ImplicitProblem, State]:
    """60 iterations into a solve of two surfaces, b = .3."""
    scene = procedural.load_scene(["face", "heart"], [P // 2, P - P // 2], FRAMES, 0, name="surfaces")
    W = standardise(scene.tracks).W
    problem = ImplicitProblem(W, present(scene.cameras), 3e-3, 0.1, **FORMS["implicit, single"])
    state = problem.start(1e-3)
    for _ in range(60):
        state = iterate(problem, state)[0]
        state = replace(state, b=1.1 * state.b)
    return problem, state


@cache
def densified(P: int) -> tuple[PrintedProblem, State]:
    """The same iterate for the dense problem."""
    problem, state = middle(P)
    U: Multiplier = state.Y3
    Y3 = U.b * (U.V.T @ U.M + U.drift.toarray()).astype(float)
    C, E = state.C.rows(slice(0, P)).astype(float), state.E.toarray().astype(float)
    return PrintedProblem(problem.W, problem.cameras, problem.l1, problem.l2), replace(state, C=C, E=E, Y3=Y3)


@cache
def structure(P: int) -> np.ndarray:
    """What the dense iteration makes of it."""
    problem, state = densified(P)
    return iterate(problem, state)[0].S


@pytest.mark.parametrize("P", [1000, 3275])
@pytest.mark.parametrize("form", ["dense", *FORMS])
def test_iteration(benchmark: BenchmarkFixture, P: int, form: str) -> None:
    benchmark.group = f"one iteration, P = {P}, F = {FRAMES}"
    problem: PrintedProblem
    problem, state = densified(P) if form == "dense" else middle(P)
    if isinstance(problem, ImplicitProblem):
        problem = replace(problem, **FORMS[form])
        benchmark.extra_info["entries of E a track"] = state.E.nnz / P
    after: State = timed(benchmark, 3, 1, iterate, problem, state)[0]
    assert np.linalg.norm(after.S - structure(P)) < 1e-3 * np.linalg.norm(structure(P))
