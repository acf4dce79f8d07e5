"""The spatial term: the exact code step for a general D, against a plain Sylvester solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import MethodError, standardise
from nrsfm.methods.multibody.lagrangian import PrintedProblem
from nrsfm.methods.multibody.problem import State, iterate
from nrsfm.methods.multibody.spatial import Neighbours, SpatialProblem
from tests.methods.parts import lagrangian, present, random_state


@pytest.fixture
def problem(small_scene: Scene) -> SpatialProblem:
    neighbours = Neighbours(small_scene.edges, small_scene.n_points, 0.7)
    return SpatialProblem(
        standardise(small_scene.tracks).W, present(small_scene.cameras), l1=0.01, l2=0.1, neighbours=neighbours
    )


@pytest.fixture
def state(problem: SpatialProblem, rng: np.random.Generator) -> State:
    """A random state."""
    F, _, P = problem.W.shape
    return random_state(rng, F, P, problem.neighbours.D.shape[1])


def slope(problem: SpatialProblem, state: State, direction: np.ndarray, step: float = 1e-4) -> float:
    up = lagrangian(problem, replace(state, C=state.C + step * direction))
    return (up - lagrangian(problem, replace(state, C=state.C - step * direction))) / (2 * step)


def test_the_term_is_what_it_stands_for(problem: SpatialProblem, rng: np.random.Generator) -> None:
    """|C D|_1 = |C|_1 + w sum |C_i - C_j|_1, each edge once however often it is given; D D' = I + w^2 L."""
    twice = np.concatenate([problem.neighbours.pairs, problem.neighbours.pairs[:, ::-1], [[3, 3]]])
    P = problem.W.shape[2]
    neighbours = Neighbours(twice, P, 0.7)
    C = rng.standard_normal((P, P))
    wanted = np.abs(C).sum() + 0.7 * sum(np.abs(C[:, i] - C[:, j]).sum() for i, j in problem.neighbours.pairs)
    assert np.abs(neighbours.differences(C)).sum() == pytest.approx(wanted)
    np.testing.assert_allclose(neighbours.differences(C), C @ neighbours.D.toarray(), atol=1e-12)
    E = rng.standard_normal(neighbours.D.shape)
    np.testing.assert_allclose(neighbours.gather(E), E @ neighbours.D.toarray().T, atol=1e-12)
    laplacian = np.zeros((P, P))
    for i, j in problem.neighbours.pairs:
        laplacian[[i, j], [i, j]] += 1
        laplacian[[i, j], [j, i]] -= 1
    np.testing.assert_allclose(neighbours.G.toarray(), np.eye(P) + 0.49 * laplacian, atol=1e-12)


def test_code_step_zeroes_the_gradient(problem: SpatialProblem, state: State, rng: np.random.Generator) -> None:
    direction = rng.standard_normal(state.C.shape)
    assert abs(slope(problem, state, direction)) > 1
    assert abs(slope(problem, replace(state, C=problem.code_step(state)), direction)) < 1e-5


def test_code_step_agrees_with_the_printed_equation(problem: SpatialProblem, state: State) -> None:
    """Eq. (20) solved literally, as a Sylvester equation."""
    P, b, D = state.C.shape[0], state.b, problem.neighbours.D.toarray()
    S, Y2, ones = state.S.reshape(-1, P), state.Y2.reshape(-1, P), np.ones((P, P))
    K = S.T @ S + ones
    rhs = K + S.T @ Y2 / b + (state.E - state.Y3 / b) @ D.T - np.outer(np.ones(P), state.Y4) / b
    np.testing.assert_allclose(problem.code_step(state), scipy.linalg.solve_sylvester(K, D @ D.T, rhs), atol=1e-9)


def test_sparse_step_is_the_minimum_with_zero_diagonal(
    problem: SpatialProblem, state: State, rng: np.random.Generator
) -> None:
    solved = replace(state, E=problem.sparse_step(state))
    P = len(state.C)
    assert np.abs(np.diag(solved.E[:, :P])).max() == 0
    lowest = lagrangian(problem, solved)
    for _ in range(50):
        change = rng.standard_normal(state.E.shape) * 10.0 ** rng.uniform(-6, 0)
        np.fill_diagonal(change[:, :P], 0)
        assert lagrangian(problem, replace(solved, E=solved.E + change)) >= lowest


def test_without_weight_it_is_the_plain_problem(small_scene: Scene) -> None:
    """A vanishing weight leaves every iterate as it is without the term."""
    W = standardise(small_scene.tracks).W
    plain = PrintedProblem(W, present(small_scene.cameras), 3e-3, 0.1)
    spatial = SpatialProblem(
        W,
        present(small_scene.cameras),
        3e-3,
        0.1,
        neighbours=Neighbours(small_scene.edges, small_scene.n_points, 1e-9),
    )
    one, two = plain.start(1e-3), spatial.start(1e-3)
    for _ in range(30):
        (one, _), (two, _) = iterate(plain, one), iterate(spatial, two)
        one, two = replace(one, b=1.1 * one.b), replace(two, b=1.1 * two.b)
    np.testing.assert_allclose(two.S, one.S, atol=1e-8)
    np.testing.assert_allclose(two.E[:, : len(two.C)], one.E, atol=1e-7)


@pytest.mark.parametrize(
    ("edges", "says"), [(np.zeros((0, 2), int), "no neighbours"), (np.array([[0, 99]]), "outside 0..4")]
)
def test_wrong_edges_are_named(edges: np.ndarray, says: str) -> None:
    with pytest.raises(MethodError, match=says):
        Neighbours(edges, 5, 1.0)
