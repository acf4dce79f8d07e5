"""One iteration of ours against the printed Sylvester equations, and against the BLAS calls that it cannot avoid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from pytest_benchmark.fixture import BenchmarkFixture

from nrsfm.datasets.cameras import orbit
from nrsfm.methods.base import Array
from nrsfm.methods.multibody.lagrangian import PrintedProblem
from nrsfm.methods.multibody.problem import State, iterate
from tests.benchmarks.timing import timed
from tests.methods.parts import random_state

SIZES = (116, 500, 1000)
FRAMES = 100


def middle(P: int) -> tuple[PrintedProblem, State]:
    """A problem of P tracks and a state in the middle of a solve."""
    rng = np.random.default_rng(0)
    problem = PrintedProblem(rng.standard_normal((FRAMES, 2, P)), orbit(FRAMES), 3e-3, 0.1)
    state = random_state(rng, FRAMES, P)
    scaled = {name: getattr(state, name) / (0.3 * P) for name in ("C", "E", "Y3")}
    return problem, replace(state, **scaled, Y4=np.zeros(P), b=1.0)


def structure_by_sylvester(problem: PrintedProblem, state: State) -> Array:
    F, _, P = problem.W.shape
    b, M = state.b, np.eye(P) - state.C
    R = scipy.linalg.block_diag(*problem.cameras)
    flat = {name: getattr(state, name).reshape(3 * F, P) for name in ("shape", "Y1", "Y2")}
    rhs = R.T @ problem.W.reshape(2 * F, P) / b + flat["shape"] + flat["Y1"] / b - flat["Y2"] / b @ M.T
    S: Array = scipy.linalg.solve_sylvester((R.T @ R + b * np.eye(3 * F)) / b, M @ M.T, rhs).reshape(F, 3, P)
    return S


def code_by_sylvester(problem: PrintedProblem, state: State) -> Array:
    P, b = state.C.shape[0], state.b
    S, Y2, ones = state.S.reshape(-1, P), state.Y2.reshape(-1, P), np.ones((P, P))
    K = S.T @ S + ones
    rhs = K + S.T @ Y2 / b + state.E - state.Y3 / b - np.outer(np.ones(P), state.Y4) / b
    C: Array = scipy.linalg.solve_sylvester(K, np.eye(P), rhs)
    return C


Step = Callable[[PrintedProblem, State], Array]


STEPS: dict[str, tuple[Step, Step]] = {
    "structure": (lambda p, s: p.structure_step(s), structure_by_sylvester),
    "code": (lambda p, s: p.code_step(s), code_by_sylvester),
}


@pytest.mark.parametrize("P", SIZES)
@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("kind", ["closed form", "sylvester"])
def test_step(benchmark: BenchmarkFixture, step: str, P: int, kind: str) -> None:
    benchmark.group = f"{step} step, P = {P}, F = {FRAMES}"
    problem, state = middle(P)
    solve = STEPS[step][kind == "sylvester"]
    result = timed(benchmark, 3, 1, solve, problem, state)
    np.testing.assert_allclose(result, STEPS[step][0](problem, state), atol=1e-7)


def unavoidable(problem: PrintedProblem, state: State) -> None:
    """The BLAS and LAPACK calls of one iteration, on operands of its sizes, and nothing else.

    Products: S'S (half), S'Y2, Y2 M', M M' (half), S C, the threshold's Gram matrix (half) and recomposition;
    factorisations: three Cholesky of P, one eigendecomposition of F; solves: 3F and P right-hand sides.
    """
    F, _, P = problem.W.shape
    S, Y2, C = state.S.reshape(-1, P), state.Y2.reshape(-1, P), state.C
    gram = scipy.linalg.blas.dsyrk(1.0, S, trans=True)
    S.T @ Y2
    factor = scipy.linalg.cho_factor(gram + (P + 1) * np.eye(P), check_finite=False)
    scipy.linalg.cho_solve(factor, C, check_finite=False)
    Y2 @ C.T
    B = scipy.linalg.blas.dsyrk(1.0, C)
    for rows in (2 * F, F):
        factor = scipy.linalg.cho_factor(B + 2 * np.eye(P), check_finite=False)
        scipy.linalg.cho_solve(factor, S[:rows].T, check_finite=False)
    S @ C
    flat = S.reshape(F, 3 * P)
    _, U = scipy.linalg.eigh(scipy.linalg.blas.dsyrk(1.0, flat), check_finite=False, driver="evd", lower=False)
    U @ (U.T @ flat)


@pytest.mark.parametrize("P", SIZES)
@pytest.mark.parametrize("kind", ["iteration", "its BLAS calls"])
def test_iteration(benchmark: BenchmarkFixture, P: int, kind: str) -> None:
    benchmark.group = f"one iteration, P = {P}, F = {FRAMES}"
    problem, state = middle(P)
    if kind == "iteration":
        timed(benchmark, 5, 1, iterate, problem, state)
    else:
        timed(benchmark, 5, 1, unavoidable, problem, state)
