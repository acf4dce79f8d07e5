"""Cameras and structure of one objective: its gradient, its descent, and what the cameras gain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nrsfm.datasets.real.mocap import load_scene
from nrsfm.datasets.real.mocap_body import load_single
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.errors import e_r
from nrsfm.methods.base import MethodError
from nrsfm.methods.numerics.linear import axes
from nrsfm.methods.structure.refinement import Objective, refine_cameras, rotations, unsteadiness
from nrsfm.methods.structure.rotation import estimate_cameras
from nrsfm.methods.structure.smooth_bmm import Smoothness
from nrsfm.reports.layouts import published
from tests.methods.parts import present

F, P = 7, 9


@pytest.fixture
def objective(rng: np.random.Generator) -> Objective:
    cameras = np.linalg.qr(rng.standard_normal((F, 3, 2)))[0].transpose(0, 2, 1)
    return Objective(rng.standard_normal((F, 2, P)), cameras, 0.3, 2.0, 3.0)


def test_the_gradient_agrees_with_finite_differences(objective: Objective, rng: np.random.Generator) -> None:
    w, A, dw, dA = (rng.standard_normal((F, n)) for n in (3, 4, 3, 4))
    _, by_w, by_A = objective(w, A)
    h = 1e-5
    over_w = (objective(w + h * dw, A)[0] - objective(w - h * dw, A)[0]) / (2 * h)
    over_A = (objective(w, A + h * dA)[0] - objective(w, A - h * dA)[0]) / (2 * h)
    assert np.sum(by_w * dw) == pytest.approx(over_w, rel=1e-6)
    assert np.sum(by_A * dA) == pytest.approx(over_A, rel=1e-6)


def test_it_does_not_depend_on_the_axes_of_the_world(objective: Objective, rng: np.random.Generator) -> None:
    A = rng.standard_normal((F, 4))
    turned = Objective(objective.W, objective.cameras @ rotations(rng.standard_normal((1, 3))), 0.3, 2.0, 3.0)
    still = np.zeros((F, 3))
    assert turned(still, A)[0] == pytest.approx(objective(still, A)[0])


def test_the_product_costs_no_more_than_the_nuclear_norm(objective: Objective, rng: np.random.Generator) -> None:
    S = rng.standard_normal((F, 3, P))
    LS = Smoothness(objective.cameras, objective.smoothing).apply(S).reshape(F, -1)
    T, d = objective.frequencies()
    t = objective.smoothing
    U, s, _ = np.linalg.svd(np.sqrt((1 + t**2 * d) / (1 + t**2))[:, None] * (T.T @ S.reshape(F, -1)))
    np.testing.assert_allclose(s, np.linalg.svd(LS)[1])  # L'L is diagonal in cosines
    bound = objective.l2 * s.sum() + 0.5 * np.sum((objective.W - objective.cameras @ S) ** 2)
    bound += 0.5 * P * objective.turning**4 * unsteadiness(axes(objective.cameras))[0]
    assert objective(np.zeros((F, 3)), U[:, :F] * np.sqrt(s))[0] <= bound


def test_uniform_turning_is_free() -> None:
    assert unsteadiness(rotations(np.outer(np.arange(9), [0.1, -0.2, 0.3])))[0] < 1e-25


def test_the_objective_never_rises_and_cameras_stay_cameras(small_scene: Scene, rng: np.random.Generator) -> None:
    truth = present(small_scene.cameras)
    rough = truth @ rotations(0.05 * rng.standard_normal((len(truth), 3)))
    refined = refine_cameras(small_scene.tracks, rough)
    assert (np.diff(refined.objective) <= 0).all()
    gram = refined.cameras @ refined.cameras.transpose(0, 2, 1)
    np.testing.assert_allclose(gram, np.tile(np.eye(2), (len(truth), 1, 1)), atol=1e-12)
    assert unsteadiness(axes(refined.cameras))[0] < 0.01 * unsteadiness(axes(rough))[0]


@pytest.mark.parametrize("settings", [{"turning": 0.0}, {"noise": -1.0}, {"smoothing": True}])
def test_settings_that_cannot_be(small_scene: Scene, settings: dict[str, float]) -> None:
    with pytest.raises(MethodError, match=next(iter(settings))):
        refine_cameras(small_scene.tracks, present(small_scene.cameras), **settings)  # type: ignore[arg-type]


@pytest.mark.data
@pytest.mark.parametrize(("name", "rank"), [("yoga", 10), ("stretch", 11)])
def test_single_bodies_are_below_the_published_error(data_folder: Path, name: str, rank: int) -> None:
    printed = published.printed("single_body", name, "bmm", "e_r")
    assert printed is not None
    scene = load_single(data_folder, name)
    refined = refine_cameras(scene.tracks, estimate_cameras(scene.tracks, rank))
    assert e_r(refined.cameras, present(scene.cameras)) < float(printed)


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("bodies", [("face", "pickup"), ("face", "yoga"), ("stretch", "yoga"), ("walking", "yoga")])
def test_pairs_gain_by_three(data_folder: Path, bodies: tuple[str, str], noise: float) -> None:
    scene = load_scene(data_folder, list(bodies)).with_noise(noise, 0)
    truth = present(scene.cameras)
    estimate = estimate_cameras(scene.tracks)
    assert e_r(refine_cameras(scene.tracks, estimate).cameras, truth) < e_r(estimate, truth) / 3
