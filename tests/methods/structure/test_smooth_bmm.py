"""The smooth low-rank prior: its steps against dense references, optimality, and the block matrix method as a limit."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from nrsfm.datasets.generated import procedural
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.errors import e_3d
from nrsfm.methods.base import Array, MethodError, Observations, standardise
from nrsfm.methods.structure.bmm import BMM, fit_shape
from nrsfm.methods.structure.smooth_bmm import IMAGES, SmoothBMM, Smoothness, fit_smooth
from tests.methods.parts import assert_least_over_depth, assert_subgradient, observed, present


def dense(n_frames: int, t: float) -> Array:
    """L'L as an array."""
    D = np.diff(np.eye(n_frames), axis=0)
    return np.asarray((np.eye(n_frames) + t**2 * D.T @ D) / (1 + t**2))


@pytest.fixture
def smoothness(small_scene: Scene) -> Smoothness:
    return Smoothness(present(small_scene.cameras), 30.0)


def test_products_agree_with_the_dense_matrix(smoothness: Smoothness, rng: np.random.Generator) -> None:
    F = len(smoothness.cameras)
    S, Z = rng.standard_normal((2, F, 3, 5))
    twice = smoothness.apply_transposed(smoothness.apply(S))
    np.testing.assert_allclose(twice, np.tensordot(dense(F, 30.0), S, 1), atol=1e-12)
    assert np.sum(smoothness.apply(S) * Z) == pytest.approx(np.sum(S * smoothness.apply_transposed(Z)))


def test_the_structure_step_solves_the_dense_system(smoothness: Smoothness, rng: np.random.Generator) -> None:
    F = len(smoothness.cameras)
    Z, U = rng.standard_normal((F, 3, 5)), rng.standard_normal((F, 2, 5))
    R = scipy.linalg.block_diag(*smoothness.cameras)
    system = np.kron(dense(F, 30.0), np.eye(3)) + IMAGES * R.T @ R
    right = smoothness.apply_transposed(Z).reshape(3 * F, 5) + IMAGES * R.T @ U.reshape(2 * F, 5)
    expected = np.linalg.solve(system, right).reshape(F, 3, 5)
    np.testing.assert_allclose(smoothness.structure(Z, U), expected, atol=1e-9)


@pytest.mark.parametrize("l2", [0.0, 0.5])
def test_without_smoothing_it_is_bmm(small_scene: Scene, l2: float) -> None:
    W, R = standardise(small_scene.tracks).W, present(small_scene.cameras)
    smooth, plain = fit_smooth(W, Smoothness(R, 0.0), l2, tol=1e-8), fit_shape(W, R, l2, tol=1e-8)
    assert np.linalg.norm(smooth.structure - plain.structure) < 1e-3 * np.linalg.norm(plain.structure)
    assert smooth.nuclear_norm == pytest.approx(plain.nuclear_norm, rel=1e-4)


def test_equality_reproduces_the_tracks(small_scene: Scene) -> None:
    structure = present(SmoothBMM().reconstruct(observed(small_scene)).structure)
    np.testing.assert_allclose(present(small_scene.cameras) @ structure, centred(small_scene.tracks), atol=1e-9)


def test_no_feasible_structure_has_a_smaller_norm(small_scene: Scene) -> None:
    """Depth is the only freedom of R S = W; no change of it lowers |L S|_*."""
    W, R = standardise(small_scene.tracks).W, present(small_scene.cameras)
    smoothness = Smoothness(R, 30.0)
    fit = fit_smooth(W, smoothness, tol=1e-9)

    def norm(S: Array) -> float:
        return float(np.linalg.norm(smoothness.apply(S).reshape(len(S), -1), "nuc"))

    assert_least_over_depth(norm, fit.structure, R)


def test_weighted_problem_is_stationary(small_scene: Scene) -> None:
    """R'(W - R S) = l2 L'G with G a subgradient of the nuclear norm at L S."""
    W, R, l2 = standardise(small_scene.tracks).W, present(small_scene.cameras), 0.1
    smoothness = Smoothness(R, 30.0)
    fit = fit_smooth(W, smoothness, l2, tol=1e-9, max_iter=20000)
    pull = smoothness.apply_transposed(-fit.multiplier)
    np.testing.assert_allclose(R.transpose(0, 2, 1) @ (W - fit.images) / l2, pull, atol=1e-4)
    assert_subgradient(-fit.multiplier.reshape(len(W), -1), fit.shape.reshape(len(W), -1), 5e-3)


def test_a_fixed_camera_leaves_depth_at_zero(small_scene: Scene) -> None:
    R = np.repeat(np.eye(3)[None, :2], small_scene.n_frames, axis=0)
    S = present(SmoothBMM().reconstruct(Observations(small_scene.tracks, R)).structure)
    assert np.abs(S[:, 2]).max() < 1e-9
    np.testing.assert_allclose(S[:, :2], centred(small_scene.tracks), atol=1e-9)


def test_it_is_nearer_to_a_smooth_body_than_bmm() -> None:
    """With gaps, too."""
    whole = procedural.load_scene(["face"], 20, 60, 0, name="smooth", placement="paper")
    for scene in (whole, whole.with_gaps("random", 0.2)):
        truth = present(scene.structure)
        plain, smooth = (present(m.reconstruct(observed(scene)).structure) for m in (BMM(), SmoothBMM()))
        assert e_3d(smooth, truth) < 0.8 * e_3d(plain, truth)


def test_the_world_may_turn(small_scene: Scene, rng: np.random.Generator) -> None:
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turned = replace(small_scene, cameras=present(small_scene.cameras) @ Q.T)
    first, second = (present(SmoothBMM().reconstruct(observed(s)).structure) for s in (small_scene, turned))
    np.testing.assert_allclose(Q @ first, second, atol=1e-6)


def test_a_negative_smoothing_is_refused(small_scene: Scene) -> None:
    with pytest.raises(MethodError, match="smoothing"):
        SmoothBMM(smoothing=-1).reconstruct(observed(small_scene))


def centred(tracks: Array) -> Array:
    return np.asarray(tracks - tracks.mean(axis=2, keepdims=True))


@pytest.mark.parametrize("method", [BMM(max_iter=5), SmoothBMM(max_iter=5)], ids=["bmm", "smooth_bmm"])
def test_the_memory_that_is_announced_suffices(method: BMM) -> None:
    scene = procedural.load_scene(["person", "face"], points=100, frames=60, seed=0, name="two", placement="paper")
    tracemalloc.start()
    method.reconstruct(observed(scene))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < method.memory(scene.n_frames, scene.n_points) < 2 * peak
