"""Weights from the data, and block updates that minimise the augmented Lagrangian."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.fft

from nrsfm.datasets.generated import procedural
from nrsfm.datasets.noise import add_noise
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.errors import e_3d, n_wrong
from nrsfm.methods.base import MethodError, Observations, standardise
from nrsfm.methods.multibody.adaptive import AdaptiveMultiBody, AdaptiveProblem
from nrsfm.methods.multibody.motion import directions, noise_variance
from nrsfm.methods.multibody.problem import State
from nrsfm.methods.structure.bmm import BMM
from tests.methods.multibody.test_printed import slope, with_block
from tests.methods.parts import lagrangian, observed, present, random_state


@pytest.fixture
def problem(small_scene: Scene) -> AdaptiveProblem:
    problem, _ = AdaptiveMultiBody().adapt(standardise(small_scene.tracks).W, present(small_scene.cameras))
    return replace(problem, l1=0.1, l2=0.1, expression=0.5)


@pytest.fixture
def state(problem: AdaptiveProblem, rng: np.random.Generator) -> State:
    """A random state."""
    F, _, P = problem.W.shape
    state = random_state(rng, F, P)
    parts = {name: getattr(state, name) for name in ("S", "shape", "C", "E", "Y1")}
    U, Y5 = rng.standard_normal((2, F, 2, P))
    return State(**parts, U=U, Y3=problem.code_penalty * state.Y3, Y5=Y5, b=state.b)


@pytest.mark.parametrize("block", ["S", "U", "C"])
def test_quadratic_steps_zero_the_gradient(
    problem: AdaptiveProblem, state: State, rng: np.random.Generator, block: str
) -> None:
    step = {"S": problem.structure_step, "U": problem.image_step, "C": problem.code_step}[block]
    direction = rng.standard_normal(getattr(state, block).shape)
    before = abs(slope(problem, state, block, direction))
    after = abs(slope(problem, with_block(state, block, step(state)), block, direction))
    assert after < 1e-6 * before


def test_exact_diagonal_is_the_constrained_minimum(
    problem: AdaptiveProblem, state: State, rng: np.random.Generator
) -> None:
    exact = replace(problem, diagonal="exact")
    solved = replace(state, C=exact.code_step(state))
    assert np.abs(np.diag(solved.C)).max() < 1e-10
    direction = rng.standard_normal(state.C.shape)
    np.fill_diagonal(direction, 0)
    assert abs(slope(exact, solved, "C", direction)) < 1e-6 * abs(slope(exact, state, "C", direction))


@pytest.mark.parametrize("block", ["E", "shape"])
def test_proximal_steps_are_minima(
    problem: AdaptiveProblem, state: State, rng: np.random.Generator, block: str
) -> None:
    result = problem.sparse_step(state) if block == "E" else problem.shape_step(state)[0]
    lowest = lagrangian(problem, with_block(state, block, result))
    for _ in range(50):
        change = rng.standard_normal(result.shape) * 10.0 ** rng.uniform(-5, 0)
        if block == "E":
            np.fill_diagonal(change, 0)
        assert lagrangian(problem, with_block(state, block, result + change)) >= lowest - 1e-9


def test_multipliers_follow_the_gaps(problem: AdaptiveProblem, state: State) -> None:
    gaps = problem.gaps(state)
    after = problem.multiplier_step(state, gaps)
    np.testing.assert_allclose(after.Y1 - state.Y1, state.b * gaps["shape"])
    np.testing.assert_allclose(after.Y5 - state.Y5, problem.penalty(state, "images") * gaps["images"])
    np.testing.assert_allclose(after.Y3 - state.Y3, problem.code_penalty * (state.C - state.E), atol=1e-15)


def test_directions_go_from_smooth_to_rough_and_leave_points_at_rest_out(small_scene: Scene) -> None:
    """Whatever the depth: they need the cameras alone."""
    R, F = present(small_scene.cameras), small_scene.n_frames
    Q = directions(R)
    np.testing.assert_allclose(Q.T @ Q, np.eye(2 * F - 3), atol=1e-10)
    assert np.abs(Q.T @ R.reshape(2 * F, 3)).max() < 1e-10
    theta = scipy.fft.idct(np.eye(F), axis=0, norm="ortho")
    motion = [Q.T @ np.einsum("fij,f->fij", R, theta[:, k]).reshape(2 * F, 3) for k in (2, 8, 20)]
    places = [np.average(np.arange(len(Q.T)), weights=(images**2).sum(axis=1)) for images in motion]
    assert places == sorted(places)


def test_a_fixed_camera_sees_two_dimensions_of_rest() -> None:
    assert directions(np.repeat(np.eye(3)[None, :2], 9, axis=0)).shape == (18, 16)


@pytest.mark.parametrize("sigma", [0.01, 0.1])
def test_noise_is_read_off_the_tracks(rng: np.random.Generator, sigma: float) -> None:
    """To 10 %, beside smooth motion and one body of three that moves as fast as the noise."""
    scene = procedural.load_scene(["person", "face", "person"], 30, 120, 0, name="noisy", placement="paper")
    jitter = np.zeros_like(scene.tracks)
    jitter[:, :, scene.labels == 2] = 0.2 * rng.standard_normal((120, 2, 30))
    W = scene.tracks + jitter + sigma * rng.standard_normal(scene.tracks.shape)
    motion = directions(present(scene.cameras)).T @ W.reshape(240, -1)
    assert np.sqrt(noise_variance(motion)) == pytest.approx(sigma, rel=0.1)


def test_weights_follow_the_noise(small_scene: Scene, rng: np.random.Generator) -> None:
    """Noisy tracks: more nuclear norm, more slack weight, a sparser code, less whitening."""
    W = standardise(small_scene.tracks).W
    noisy = standardise(W + 0.05 * rng.standard_normal(W.shape)).W
    method = AdaptiveMultiBody()
    clean, other = (method.adapt(tracks, present(small_scene.cameras))[0] for tracks in (W, noisy))
    assert clean.l1 < other.l1 and clean.l2 < other.l2 and clean.expression < other.expression
    assert method.l1[0] < other.l1 < method.l1[1]
    assert np.ptp(np.log(clean.w)) > np.ptp(np.log(other.w))


def test_offsets_and_static_shape_do_not_matter_to_the_code(small_scene: Scene, rng: np.random.Generator) -> None:
    """Points moved by any constant 3D vector each show the same motion."""
    R, P = present(small_scene.cameras), small_scene.n_points
    moved = small_scene.tracks + R @ rng.standard_normal((3, P))
    Q = directions(R)
    first, second = (Q.T @ tracks.reshape(len(Q), P) for tracks in (small_scene.tracks, moved))
    np.testing.assert_allclose(first, second, atol=1e-10)


def test_a_scene_at_rest_is_refused_and_a_track_at_rest_is_not() -> None:
    scene = procedural.load_scene(["person", "face"], 8, 60, 0, name="still")
    still = present(scene.cameras) @ np.repeat(present(scene.structure)[:1], 60, axis=0)
    with pytest.raises(MethodError, match="nothing moves"):
        AdaptiveMultiBody().reconstruct(Observations(still, scene.cameras), 2)
    moving = scene.tracks.copy()
    moving[:, :, 0] = still[:, :, 0]
    result = AdaptiveMultiBody(max_iter=5).reconstruct(Observations(moving, scene.cameras), 2)
    assert np.isfinite(present(result.structure)).all() and np.isfinite(present(result.affinity)).all()


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"diagonal": "none"}, "diagonal"),
        ({"l1": 0.1}, "l1"),
        ({"l1": [0.1]}, "l1"),
        ({"whitening": [0.5, "a"]}, "whitening"),
        ({"nuclear": float("nan")}, "nuclear"),
        ({"expression": 0.0}, "expression"),
        ({"noise": -1.0}, "noise"),
        ({"floor": 0}, "floor"),
        ({"max_iter": 0}, "max_iter"),
    ],
)
def test_bad_settings_are_named(small_scene: Scene, settings: dict[str, Any], word: str) -> None:
    with pytest.raises(MethodError, match=word):
        AdaptiveMultiBody(**settings).reconstruct(Observations(small_scene.tracks, small_scene.cameras), 2)


def test_noise_is_taken_out_of_the_images() -> None:
    """The structure is seen nearer to the true tracks than the noisy tracks are."""
    scene = procedural.load_scene(["person", "face"], 30, 80, 0, name="denoised", placement="paper")
    noisy = add_noise(scene.tracks, 0.02, 0, "denoised")
    result = AdaptiveMultiBody(max_iter=30).reconstruct(Observations(noisy, scene.cameras), 2)
    left = np.linalg.norm(present(scene.cameras) @ present(result.structure) - scene.tracks)
    assert left < 0.75 * np.linalg.norm(noisy - scene.tracks)


@pytest.mark.parametrize("diagonal", ["threshold", "exact"])
def test_separates_and_reconstructs_as_the_block_matrix_method(diagonal: str) -> None:
    """Bodies whose rough motions lie in separate subspaces, with all else in common."""
    scene = two_rough_bodies()
    result = AdaptiveMultiBody(diagonal=diagonal).reconstruct(Observations(scene.tracks, scene.cameras), 2)
    assert n_wrong(present(result.labels), present(scene.labels)) == 0
    alone, truth = present(BMM().reconstruct(observed(scene)).structure), present(scene.structure)
    assert e_3d(present(result.structure), truth) < 1.02 * e_3d(alone, truth)
    assert result.history["shape"][-1] < 1e-3


def two_rough_bodies() -> Scene:
    """Two intersecting clouds of points, each with 3 rough deformations of its own."""
    rng = np.random.default_rng(1)
    base = procedural.load_scene(["person", "face"], 20, 120, 0, name="rough", placement="intersecting")
    theta = scipy.fft.idct(np.eye(120, 50), axis=0, norm="ortho")[:, 25:]
    structure = np.repeat(present(base.structure).mean(axis=0, keepdims=True), 120, axis=0)
    for body in (0, 1):
        time = theta @ rng.standard_normal((25, 3))
        structure[:, :, base.labels == body] += 0.05 * np.einsum("fk,kip->fip", time, rng.standard_normal((3, 3, 20)))
    structure -= structure.mean(axis=2, keepdims=True)
    return replace(base, structure=structure, tracks=present(base.cameras) @ structure)
