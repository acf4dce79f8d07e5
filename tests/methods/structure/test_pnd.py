"""The Procrustean normal distribution: its alignment, gradient and steps, and a published error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.real.mocap_body import load_single
from nrsfm.harness.evaluate import errors, metrics
from nrsfm.methods.base import Observations
from nrsfm.methods.structure.pnd import PND, Distribution, Moments, align, descend, expected, fit, lift, tangents
from nrsfm.methods.structure.rotation import estimate_cameras
from tests.methods.parts import present

F, P = 6, 5


@pytest.fixture
def mean(rng: np.random.Generator) -> np.ndarray:
    m: np.ndarray = rng.standard_normal((P, 3))
    m /= np.linalg.norm(m)
    return m


@pytest.fixture
def moments(rng: np.random.Generator, mean: np.ndarray) -> Moments:
    X = mean + 0.2 * rng.standard_normal((F, P, 3))
    L = 0.1 * rng.standard_normal((F, 3 * P, 3 * P))
    flat = X.reshape(F, 3 * P)
    seconds = flat[:, :, None] * flat[:, None] + L @ L.transpose(0, 2, 1)
    return Moments(X, seconds.reshape(F, P, 3, P, 3)).turned(Rotation.random(F, random_state=0).as_matrix())


def test_alignment_takes_turn_and_scale(moments: Moments, mean: np.ndarray) -> None:
    """<m, Y> = 1 and Y m' symmetric; a shape turned and scaled before is aligned to the same."""
    Y = align(moments.shapes, mean).shapes
    B = np.einsum("fpi,pj->fij", Y, mean)
    np.testing.assert_allclose(np.einsum("fii->f", B), 1)
    np.testing.assert_allclose(B, B.transpose(0, 2, 1), atol=1e-12)
    other = 3 * moments.shapes @ Rotation.from_rotvec([1, -2, 0.5]).as_matrix()
    np.testing.assert_allclose(align(other, mean).shapes, Y, atol=1e-12)


def test_second_moments_turn_with_the_shapes(moments: Moments) -> None:
    T = Rotation.random(F, random_state=1).as_matrix()
    turned = moments.turned(T)
    for f in range(F):
        big = np.kron(np.eye(P), T[f])
        wanted = big @ moments.seconds[f].reshape(3 * P, 3 * P) @ big.T
        np.testing.assert_allclose(turned.seconds[f].reshape(3 * P, 3 * P), wanted, atol=1e-12)
        np.testing.assert_allclose(turned.shapes[f].ravel(), big @ moments.shapes[f].ravel(), atol=1e-12)


def test_tangents_are_turns_and_scale(mean: np.ndarray) -> None:
    w, h = np.array([0.3, -0.2, 0.7]), 1e-6
    turned = mean @ Rotation.from_rotvec(h * w).as_matrix().T
    np.testing.assert_allclose((turned - mean).ravel() / h, tangents(mean)[:, 1:] @ w, atol=1e-5)


def test_the_gradient_is_the_slope_along_the_sphere(
    moments: Moments, mean: np.ndarray, rng: np.random.Generator
) -> None:
    v = rng.standard_normal((P, 3))
    v -= np.sum(v * mean) * mean

    def cost(h: float) -> float:
        m = mean + h * v
        return fit(moments, m / np.linalg.norm(m)).cost

    slope = (cost(1e-5) - cost(-1e-5)) / 2e-5
    found = fit(moments, mean)
    assert np.sum(found.gradient * v) == pytest.approx(slope, rel=1e-6)
    assert np.sum(found.gradient * mean) == pytest.approx(0, abs=1e-10)


def test_the_cost_does_not_depend_on_turns_of_the_shapes(moments: Moments, mean: np.ndarray) -> None:
    turned = moments.turned(Rotation.random(F, random_state=2).as_matrix())
    assert fit(turned, mean).cost == pytest.approx(fit(moments, mean).cost, rel=1e-10)


def test_a_step_lowers_the_cost(moments: Moments, mean: np.ndarray) -> None:
    m, found, _ = descend(moments, mean, 1.0)
    assert np.linalg.norm(m) == pytest.approx(1)
    assert found.cost < fit(moments, mean).cost


def test_the_expected_shapes_are_the_posterior(moments: Moments, mean: np.ndarray, rng: np.random.Generator) -> None:
    """Against the normal distribution of a linear model, frame by frame, with the prior's precision G' Q S^-1 Q' G."""
    model, v = fit(moments, mean), 0.02
    D = rng.standard_normal((F, P, 2))
    found, _ = expected(D, model, v)
    cut = np.kron(np.eye(P), np.eye(2, 3))
    for f in range(F):
        G = np.kron(np.eye(P), model.alignment.scales[f] * model.alignment.rotations[f])
        covariance = np.linalg.inv(G.T @ model.precision @ G + cut.T @ cut / v)
        x = covariance @ cut.T @ D[f].ravel() / v
        np.testing.assert_allclose(found.shapes[f].ravel(), x, atol=1e-9)
        np.testing.assert_allclose(found.seconds[f].reshape(3 * P, 3 * P), covariance + np.outer(x, x), atol=1e-9)


def test_the_noise_is_that_of_its_step(moments: Moments, mean: np.ndarray, rng: np.random.Generator) -> None:
    """The expected squared residual of the images; it may fall to twice that at most."""
    D = rng.standard_normal((F, P, 2))
    model: Distribution = fit(moments, mean)
    found, v = expected(D, model, 1.0)
    cut = np.kron(np.eye(P), np.eye(2, 3))
    wanted = sum(
        np.sum(D[f] ** 2)
        - 2 * D[f].ravel() @ cut @ found.shapes[f].ravel()
        + np.trace(cut @ found.seconds[f].reshape(3 * P, 3 * P) @ cut.T)
        for f in range(F)
    )
    new = wanted / D.size
    assert v == pytest.approx(min(2 * new, max(1.0, new)))


def test_a_rigid_shape_is_lifted() -> None:
    R = orbit(12, 20.0)
    mu = np.random.default_rng(0).standard_normal((3, P))
    D = (R @ mu).transpose(0, 2, 1)
    X = lift(D, R)
    np.testing.assert_allclose(X[:, :, 2], np.cross(R[:, 0], R[:, 1]) @ mu, atol=1e-9)


def test_shapes_of_the_model_come_back(rng: np.random.Generator) -> None:
    """A mean shape and two modes of normal weights, before a camera that turns."""
    n, points = 40, 8
    modes = np.stack([np.ones(n), *(0.15 * rng.standard_normal((2, n)))], axis=1)
    S = (modes @ rng.standard_normal((3, 3 * points))).reshape(n, 3, points)
    S -= S.mean(axis=2, keepdims=True)
    R = orbit(n, 17.0)
    values: list[float] = []
    observations = Observations(project(R, S), R, progress=lambda i, n, found: values.append(found["objective"]))
    found = present(PND(tol=1e-2).reconstruct(observations).structure)
    assert errors.e_3d_procrustes(found, S) < 0.02
    assert np.all(np.diff(values) < 0)


@pytest.mark.data
@pytest.mark.slow
def test_published_error(data_folder: Path) -> None:
    """The authors' program, stopped at the same fall: .0166 in the camera's frame, e_3d_dai."""
    scene = load_single(data_folder, "yoga")
    result = PND(tol=0.05).reconstruct(Observations(scene.tracks, estimate_cameras(scene.tracks, rank=10)))
    found = metrics.evaluate(scene, result, known_cameras=False)
    assert found["e_3d_dai_cam"] == pytest.approx(0.0166, rel=0.1)


def test_turning_the_world_turns_the_structure(rng: np.random.Generator) -> None:
    """The cameras are a start, and their world is the result's."""
    A = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    R = orbit(20, 17.0)
    S = rng.standard_normal((3, 6)) + 0.1 * rng.standard_normal((20, 3, 6))
    W = project(R, S - S.mean(axis=2, keepdims=True))
    one, other = (present(PND(max_iter=5).reconstruct(Observations(W, cameras)).structure) for cameras in (R, R @ A.T))
    np.testing.assert_allclose(other, A @ one, atol=1e-6 * np.abs(one).max())
