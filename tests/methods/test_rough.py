"""The code of rough motion: what is removed, and that every block update minimises the augmented Lagrangian."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.fft

from datasets import procedural
from datasets.scene import Scene
from harness.metrics import e_3d, n_wrong
from methods.base import MethodError, standardise
from methods.bmm import BMM
from methods.lagrangian import State
from methods.multibody import MultiBody
from methods.rough import RoughProblem, smooth_images
from tests.methods.test_multibody import slope


@pytest.fixture
def problem(small_scene: Scene) -> RoughProblem:
    W = standardise(small_scene.tracks).W
    return RoughProblem(W, small_scene.cameras, l1=0.01, l2=0.1, expression=0.5, period=12)


@pytest.fixture
def state(problem: RoughProblem, rng: np.random.Generator) -> State:
    """A state in the middle of nowhere, but for the multipliers that play no part."""
    F, _, P = problem.W.shape
    triple = lambda: rng.standard_normal((F, 3, P))  # noqa: E731
    square = lambda: 0.3 * rng.standard_normal((P, P))  # noqa: E731
    still = problem.start(0.7)
    return replace(
        still, S=triple(), shape=triple(), C=square(), E=square(), Y1=triple(), Y3=problem.code_penalty * square()
    )


@pytest.mark.parametrize("block", ["S", "C"])
def test_quadratic_steps_zero_the_gradient(
    problem: RoughProblem, state: State, rng: np.random.Generator, block: str
) -> None:
    step = {"S": problem.structure_step, "C": problem.code_step}[block]
    direction = rng.standard_normal(getattr(state, block).shape)
    before = abs(slope(problem, state, block, direction))
    after = abs(slope(problem, replace(state, **{block: step(state)}), block, direction))
    assert after < 1e-6 * before


def test_exact_diagonal_is_the_constrained_minimum(
    problem: RoughProblem, state: State, rng: np.random.Generator
) -> None:
    exact = replace(problem, diagonal="exact")
    solved = replace(state, C=exact.code_step(state))
    assert np.abs(np.diag(solved.C)).max() < 1e-10
    direction = rng.standard_normal(state.C.shape)
    np.fill_diagonal(direction, 0)
    assert abs(slope(exact, solved, "C", direction)) < 1e-6 * abs(slope(exact, state, "C", direction))


@pytest.mark.parametrize("block", ["E", "shape"])
def test_proximal_steps_are_minima(problem: RoughProblem, state: State, rng: np.random.Generator, block: str) -> None:
    found = problem.sparse_step(state) if block == "E" else problem.shape_step(state)[0]
    lowest = problem.lagrangian(replace(state, **{block: found}))
    for _ in range(50):
        change = rng.standard_normal(found.shape) * 10.0 ** rng.uniform(-5, 0)
        if block == "E":
            np.fill_diagonal(change, 0)
        assert problem.lagrangian(replace(state, **{block: found + change})) >= lowest - 1e-9


def test_multipliers_follow_the_gaps(problem: RoughProblem, state: State) -> None:
    gaps = problem.gaps(state)
    after = problem.multiplier_step(state, gaps)
    np.testing.assert_allclose(after.Y1 - state.Y1, state.b * (state.shape - state.S))
    np.testing.assert_allclose(after.Y3 - state.Y3, problem.code_penalty * (state.C - state.E), atol=1e-15)


def test_slow_motion_leaves_no_trace_and_fast_motion_does(small_scene: Scene, rng: np.random.Generator) -> None:
    """Also of points whose depth is not known: the projector needs the cameras alone."""
    R, F = small_scene.cameras, small_scene.n_frames
    smooth = smooth_images(R, 12)
    np.testing.assert_allclose(smooth.T @ smooth, np.eye(smooth.shape[1]), atol=1e-12)
    theta = scipy.fft.idct(np.eye(F), axis=0, norm="ortho")
    for vector, slow in ((0, True), (2 * F // 12 - 1, True), (2 * F // 12, False)):
        W = (R @ np.einsum("f,ip->fip", theta[:, vector], rng.standard_normal((3, 4)))).reshape(2 * F, 4)
        left = np.linalg.norm(W - smooth @ (smooth.T @ W)) / np.linalg.norm(W)
        assert left < 1e-12 if slow else left > 0.1


def test_offsets_and_static_shape_do_not_matter_to_the_code(small_scene: Scene, rng: np.random.Generator) -> None:
    """Points moved by any constant 3D vector each have the same scale and the same rough tracks."""
    R = small_scene.cameras
    moved = small_scene.tracks + R @ rng.standard_normal((3, small_scene.n_points))
    first, second = (RoughProblem(W, R, 0.01, 0.1, period=12) for W in (small_scene.tracks, moved))
    P = small_scene.n_points
    np.testing.assert_allclose(first.rough(first.W.reshape(-1, P)), second.rough(second.W.reshape(-1, P)), atol=1e-10)


def test_nothing_rough_is_said() -> None:
    rigid = procedural.load_scene(["person", "face"], 8, 60, 0, name="still")
    still = rigid.cameras @ np.repeat(rigid.structure[:1], 60, axis=0)
    with pytest.raises(MethodError, match="period"):
        MultiBody().reconstruct(still, rigid.cameras, 2)


def test_a_period_that_leaves_no_dimension_is_refused(small_scene: Scene) -> None:
    with pytest.raises(MethodError, match="period"):
        smooth_images(small_scene.cameras, 3.0)


@pytest.mark.parametrize("diagonal", ["threshold", "exact"])
def test_separates_and_reconstructs_as_the_block_matrix_method(diagonal: str) -> None:
    """Bodies whose rough motions lie in separate subspaces, with all else in common."""
    scene = two_rough_bodies()
    found = MultiBody(diagonal=diagonal).reconstruct(scene.tracks, scene.cameras, 2)
    assert n_wrong(found.labels, scene.labels) == 0
    alone = BMM().reconstruct(scene.tracks, scene.cameras).structure
    assert e_3d(found.structure, scene.structure) < 1.02 * e_3d(alone, scene.structure)
    assert found.history["shape"][-1] < 1e-3


def two_rough_bodies() -> Scene:
    """Two intersecting clouds of points, each with 3 rough deformations of its own."""
    rng = np.random.default_rng(1)
    base = procedural.load_scene(["person", "face"], 20, 120, 0, name="rough", placement="intersecting")
    theta = scipy.fft.idct(np.eye(120, 50), axis=0, norm="ortho")[:, 25:]
    structure = np.repeat(base.structure.mean(axis=0, keepdims=True), 120, axis=0)
    for body in (0, 1):
        time = theta @ rng.standard_normal((25, 3))
        structure[:, :, base.labels == body] += 0.05 * np.einsum("fk,kip->fip", time, rng.standard_normal((3, 3, 20)))
    structure -= structure.mean(axis=2, keepdims=True)
    return replace(base, structure=structure, tracks=base.cameras @ structure)
