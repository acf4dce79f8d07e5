"""The printed method: each block update minimises the augmented Lagrangian, and a solve recovers known bodies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

from nrsfm.datasets.generated import procedural
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.errors import e_3d, n_wrong
from nrsfm.methods.base import Method, MethodError, Observations, standardise
from nrsfm.methods.multibody.adaptive import AdaptiveMultiBody
from nrsfm.methods.multibody.lagrangian import PrintedProblem
from nrsfm.methods.multibody.printed import STARTS, MultiBody
from nrsfm.methods.multibody.problem import Problem, State
from nrsfm.methods.structure.bmm import BMM
from tests.methods.parts import lagrangian, present, random_state


@pytest.fixture
def problem(small_scene: Scene) -> PrintedProblem:
    return PrintedProblem(standardise(small_scene.tracks).W, present(small_scene.cameras), l1=0.01, l2=0.1)


@pytest.fixture
def state(problem: PrintedProblem, rng: np.random.Generator) -> State:
    """A random state with a medium penalty."""
    F, _, P = problem.W.shape
    return random_state(rng, F, P)


def slope(problem: Problem, state: State, name: str, direction: np.ndarray, step: float = 1e-4) -> float:
    """Central difference of the augmented Lagrangian along a direction of one variable."""
    value = getattr(state, name)
    up = lagrangian(problem, with_block(state, name, value + step * direction))
    down = lagrangian(problem, with_block(state, name, value - step * direction))
    return (up - down) / (2 * step)


def with_block(state: State, name: str, value: np.ndarray) -> State:
    """The state with another value of one variable."""
    blocks: dict[str, Any] = {name: value}
    return replace(state, **blocks)


def test_structure_step_zeroes_the_gradient(problem: PrintedProblem, state: State, rng: np.random.Generator) -> None:
    direction = rng.standard_normal(state.S.shape)
    assert abs(slope(problem, state, "S", direction)) > 1
    solved = replace(state, S=problem.structure_step(state))
    assert abs(slope(problem, solved, "S", direction)) < 1e-5


def test_code_step_zeroes_the_gradient(problem: PrintedProblem, state: State, rng: np.random.Generator) -> None:
    direction = rng.standard_normal(state.C.shape)
    assert abs(slope(problem, state, "C", direction)) > 1
    solved = replace(state, C=problem.code_step(state))
    assert abs(slope(problem, solved, "C", direction)) < 1e-5


def test_exact_diagonal_is_the_constrained_minimum(
    problem: PrintedProblem, state: State, rng: np.random.Generator
) -> None:
    exact = replace(problem, diagonal="exact")
    solved = replace(state, C=exact.code_step(state))
    assert np.abs(np.diag(solved.C)).max() < 1e-10
    direction = rng.standard_normal(state.C.shape)
    assert abs(slope(exact, solved, "C", direction)) > 1e-3  # the constraint holds it away from the free minimum
    np.fill_diagonal(direction, 0)
    assert abs(slope(exact, solved, "C", direction)) < 1e-5


def test_paper_diagonal_is_not_a_minimum(problem: PrintedProblem, state: State, rng: np.random.Generator) -> None:
    printed = replace(problem, diagonal="paper")
    solved = replace(state, C=printed.code_step(state))
    assert np.abs(np.diag(solved.C)).max() == 0
    direction = rng.standard_normal(state.C.shape)
    np.fill_diagonal(direction, 0)
    assert abs(slope(printed, solved, "C", direction)) > 1e-2


def test_sparse_step_is_the_minimum_with_zero_diagonal(
    problem: PrintedProblem, state: State, rng: np.random.Generator
) -> None:
    solved = replace(state, E=problem.sparse_step(state))
    assert np.abs(np.diag(solved.E)).max() == 0
    assert 0 < np.count_nonzero(solved.E) < solved.E.size
    lowest = lagrangian(problem, solved)
    for _ in range(50):
        change = rng.standard_normal(state.E.shape) * 10.0 ** rng.uniform(-6, 0)
        np.fill_diagonal(change, 0)
        assert lagrangian(problem, replace(solved, E=solved.E + change)) >= lowest


def test_shape_step_is_the_minimum(problem: PrintedProblem, state: State, rng: np.random.Generator) -> None:
    shape, norm = problem.shape_step(state)
    flat = shape.reshape(len(shape), -1)
    assert norm == pytest.approx(np.linalg.norm(flat, "nuc"), rel=1e-8)
    lowest = lagrangian(problem, replace(state, shape=shape))
    for _ in range(50):
        change = rng.standard_normal(shape.shape) * 10.0 ** rng.uniform(-6, 0)
        assert lagrangian(problem, replace(state, shape=shape + change)) >= lowest - 1e-9


def test_steps_agree_with_the_printed_equations(problem: PrintedProblem, state: State) -> None:
    """Eqs. (14) and (20) solved literally, as Sylvester equations with a block-diagonal R."""
    F, _, P = problem.W.shape
    b = state.b
    R = scipy.linalg.block_diag(*problem.cameras)
    flat = {name: getattr(state, name).reshape(3 * F, P) for name in ("S", "shape", "Y1", "Y2")}
    M = np.eye(P) - state.C
    left = (R.T @ R + b * np.eye(3 * F)) / b
    rhs = R.T @ problem.W.reshape(2 * F, P) / b + flat["shape"] + flat["Y1"] / b - flat["Y2"] / b @ M.T
    S = scipy.linalg.solve_sylvester(left, M @ M.T, rhs)
    np.testing.assert_allclose(problem.structure_step(state).reshape(3 * F, P), S, atol=1e-9)

    ones = np.ones((P, P))
    K = flat["S"].T @ flat["S"]
    rhs = K + flat["S"].T @ flat["Y2"] / b + state.E - state.Y3 / b + ones - np.outer(np.ones(P), state.Y4) / b
    C = scipy.linalg.solve_sylvester(K + ones, np.eye(P), rhs)
    np.testing.assert_allclose(problem.code_step(state), C, atol=1e-9)


def test_multipliers_follow_the_gaps(problem: PrintedProblem, state: State) -> None:
    gaps = problem.gaps(state)
    after = problem.multiplier_step(state, gaps)
    np.testing.assert_allclose(after.Y1 - state.Y1, state.b * (state.shape - state.S))
    S, C = state.S.reshape(-1, state.C.shape[0]), state.C
    np.testing.assert_allclose((after.Y2 - state.Y2).reshape(S.shape), state.b * (S - S @ C))
    np.testing.assert_allclose(after.Y3 - state.Y3, state.b * (C - state.E))
    np.testing.assert_allclose(after.Y4 - state.Y4, state.b * (C.sum(axis=0) - 1))


@pytest.mark.parametrize("diagonal", ["threshold", "exact"])
def test_separates_and_reconstructs(diagonal: str) -> None:
    scene = procedural.load_scene(["person", "face"], 40, 120, 0, name="apart", placement=[3, 0, 0])
    result = MultiBody(diagonal=diagonal).reconstruct(Observations(scene.tracks, scene.cameras), 2)
    assert n_wrong(present(result.labels), present(scene.labels)) == 0
    assert e_3d(present(result.structure), present(scene.structure)) < 0.06
    for name in ("shape", "expression", "code", "affine"):
        assert result.history[name][-1] < 0.01 * result.history[name].max()


def test_the_printed_diagonal_breaks_the_minimisation(small_scene: Scene) -> None:
    """While b grows, C - diag(C) after the C-step leaves S far from S C where the exact step closes the gap."""
    gap = {
        diagonal: MultiBody(diagonal=diagonal, max_penalty=1e3)
        .reconstruct(Observations(small_scene.tracks, small_scene.cameras), 2)
        .history["expression"][-1]
        for diagonal in ("threshold", "paper")
    }
    assert gap["paper"] > 10 * gap["threshold"]


@pytest.mark.parametrize("method", [MultiBody(max_iter=40), AdaptiveMultiBody(max_iter=20)])
def test_scaling_and_moving_the_image_changes_nothing_but_the_scale(small_scene: Scene, method: Method) -> None:
    plain = method.reconstruct(Observations(small_scene.tracks, small_scene.cameras), 2)
    moved = method.reconstruct(Observations(1000 * small_scene.tracks + 7, small_scene.cameras), 2)
    np.testing.assert_allclose(present(moved.structure), 1000 * present(plain.structure), rtol=1e-6, atol=1e-4)
    np.testing.assert_array_equal(present(moved.labels), present(plain.labels))


@pytest.mark.parametrize("method", [MultiBody(max_iter=40), AdaptiveMultiBody(max_iter=20)])
def test_rotating_the_world_rotates_the_structure(small_scene: Scene, rng: np.random.Generator, method: Method) -> None:
    Q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    plain = method.reconstruct(Observations(small_scene.tracks, small_scene.cameras), 2)
    turned = method.reconstruct(Observations(small_scene.tracks, present(small_scene.cameras) @ Q.T), 2)
    if np.linalg.det(Q) < 0:
        Q = -Q
        turned = method.reconstruct(Observations(small_scene.tracks, present(small_scene.cameras) @ Q.T), 2)
    np.testing.assert_allclose(present(turned.structure), Q @ present(plain.structure), atol=1e-6)


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"diagonal": "none"}, "diagonal"),
        ({"start": "random"}, "start"),
        ({"cut": "min"}, "cut"),
        ({"l1": 0.0}, "l1"),
        ({"l2": float("nan")}, "l2"),
        ({"growth": 0.5}, "growth"),
        ({"max_iter": 0}, "max_iter"),
        ({"form": "sparse"}, "form"),
        ({"precision": "half"}, "precision"),
        ({"spatial": 1.0}, "no neighbours"),
        ({"spatial": -1.0}, "spatial"),
        ({"form": "implicit", "diagonal": "exact"}, "diagonal"),
        ({"spatial": 1.0, "diagonal": "exact"}, "diagonal"),
    ],
)
def test_bad_settings_are_named(small_scene: Scene, settings: dict[str, Any], word: str) -> None:
    with pytest.raises(MethodError, match=word):
        MultiBody(**settings).reconstruct(Observations(small_scene.tracks, small_scene.cameras), 2)


def test_the_start_by_bmm_is_the_structure_of_least_nuclear_norm(small_scene: Scene) -> None:
    """One iteration at a tiny penalty hardly moves it; pinv(R) W has no depth and is further from the truth."""
    observations = Observations(small_scene.tracks, small_scene.cameras)
    first = present(BMM().reconstruct(observations).structure)
    near, flat = (
        present(MultiBody(start=start, max_iter=1, penalty=1e-9, l2=1e-12).reconstruct(observations, 2).structure)
        for start in STARTS
    )
    assert e_3d(near, first) < 0.1 * e_3d(flat, first)


def test_one_body_has_one_label(small_scene: Scene) -> None:
    result = MultiBody(max_iter=5).reconstruct(Observations(small_scene.tracks, small_scene.cameras), 1)
    assert result.labels is not None and not result.labels.any()


@pytest.mark.parametrize("spatial", [0.0, 1.0])
def test_the_form_changes_nothing(small_scene: Scene, spatial: float) -> None:
    """Dense, or sparse plus low rank, which is taken where the dense one is foreseen to be too large."""
    forms: dict[str, dict[str, Any]] = {
        "dense": {},
        "large": {"dense_gb": 0.0},
        "single": {"dense_gb": 0, "precision": "single"},
    }
    solve = {
        form: MultiBody(spatial=spatial, max_iter=60, **settings).reconstruct(
            Observations(small_scene.tracks, small_scene.cameras, edges=small_scene.edges), 2
        )
        for form, settings in forms.items()
    }
    dense, large, single = solve["dense"], solve["large"], solve["single"]
    assert isinstance(dense.affinity, np.ndarray) and isinstance(large.affinity, sp.sparray)
    np.testing.assert_allclose(present(large.structure), present(dense.structure), atol=1e-9)
    np.testing.assert_allclose(large.affinity.toarray(), dense.affinity, atol=1e-8)
    for name in ("objective", "shape", "expression", "code", "affine"):
        curve = dense.history[name]
        np.testing.assert_allclose(large.history[name], curve, atol=1e-8, rtol=1e-8)
    np.testing.assert_allclose(present(single.structure), present(dense.structure), atol=2e-3)
    np.testing.assert_array_equal(present(large.labels), present(dense.labels))


def test_memory_is_foreseen_by_the_form() -> None:
    printed = MultiBody()
    assert printed.memory(99, 500) == MultiBody(form="dense").memory(99, 500)
    dense = MultiBody(form="dense").memory(99, 28_880)
    assert dense > 60 * 2**30 > 10 * printed.memory(99, 28_880)
    assert MultiBody(spatial=1.0).memory(9, 500, 900) > printed.memory(9, 500, 900)
