"""The scale of each frame: exact where bodies are rigid, and moved by zoom exactly, whatever deforms."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from nrsfm.datasets.corruption import zoom_factors
from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import Array, Cleaned
from nrsfm.methods.observed.cleaning import at_one_scale
from nrsfm.methods.observed.scale import REST, RIGID, estimate_scales
from nrsfm.methods.structure.pta import trajectory_basis
from nrsfm.methods.structure.rotation import estimate_cameras
from tests.conftest import PAIRS
from tests.methods.observed.parts import load
from tests.methods.parts import present


def zoomed(scene: Scene, zooming: str = "random") -> tuple[Array, Array]:
    """Tracks with 30 % of zoom, and the factors."""
    factors = zoom_factors(scene.n_frames, 0.3, zooming, 3)
    return scene.tracks * factors[:, None, None], factors


def rigid(scene: Scene) -> Array:
    """Tracks of the scene's first shape before its cameras."""
    return np.asarray(present(scene.cameras) @ present(scene.structure)[0])


@pytest.mark.parametrize("zooming", ["smooth", "random"])
def test_scales_of_a_rigid_scene_are_exact(small_scene: Scene, zooming: str) -> None:
    factors = zoomed(small_scene, zooming)[1]
    found = estimate_scales(rigid(small_scene) * factors[:, None, None], present(small_scene.cameras))
    np.testing.assert_allclose(found.scales, factors, rtol=1e-3)
    assert found.significant


@pytest.mark.parametrize("zooming", ["smooth", "random"])
def test_zoom_moves_the_scales_by_itself(small_scene: Scene, zooming: str) -> None:
    """Bodies that deform give scales that are off, by the same factors with zoom and without."""
    tracks, factors = zoomed(small_scene, zooming)
    still = estimate_scales(small_scene.tracks, present(small_scene.cameras))
    moved = estimate_scales(tracks, present(small_scene.cameras))
    np.testing.assert_allclose(moved.scales, factors * still.scales, rtol=2e-3)


def test_scales_depend_on_no_axes_units_or_order(small_scene: Scene, rng: np.random.Generator) -> None:
    tracks, _ = zoomed(small_scene)
    cameras = present(small_scene.cameras)
    expected = estimate_scales(tracks, cameras)
    turn = scipy.linalg.qr(rng.standard_normal((3, 3)))[0]
    shift = rng.standard_normal((len(tracks), 2, 1))
    order = rng.permutation(small_scene.n_points)
    for changed in (
        estimate_scales(tracks, cameras @ turn),
        estimate_scales(40 * tracks + shift, cameras),
        estimate_scales(tracks[:, :, order], cameras),
    ):
        np.testing.assert_allclose(changed.scales, expected.scales, rtol=1e-4)
        assert changed.gain == pytest.approx(expected.gain, rel=1e-3)


def test_scales_are_a_minimum_of_the_likelihood(small_scene: Scene, rng: np.random.Generator) -> None:
    """Against the module's formula, written out with a dense K."""
    tracks, cameras = small_scene.tracks, present(small_scene.cameras)
    F = len(tracks)
    at_rest = scipy.linalg.orth(cameras.reshape(2 * F, 3))
    project = np.eye(2 * F) - at_rest @ at_rest.T
    theta = trajectory_basis(F, 6)[:, 1:] / np.arange(1, 6)
    drift = project @ np.einsum("fij,fk->fikj", cameras, theta).reshape(2 * F, -1)
    covariance = drift @ drift.T / np.linalg.norm(drift, 2) ** 2 + REST * np.eye(2 * F)
    K = REST * project @ np.linalg.inv(covariance) @ project
    i, j = np.triu_indices(small_scene.n_points, 1)
    centred = tracks - tracks.mean(axis=2, keepdims=True)
    pairs = (tracks[:, :, i] - tracks[:, :, j]).reshape(2 * F, -1)

    def objective(log_u: Array) -> float:
        u = np.exp(log_u - log_u.mean())
        Y = np.repeat(u, 2)[:, None] * pairs
        least = (RIGID * u) ** 2 * np.mean(centred**2)
        return float(np.log(np.einsum("ip,ij,jp->p", Y, K, Y) + least.sum()).mean())

    found = -np.log(estimate_scales(tracks, cameras, tol=1e-8, max_iter=200).scales)
    least = objective(found)
    for _ in range(20):
        step = 1e-3 * rng.standard_normal(F)
        assert objective(found + step) > least
    assert objective(np.zeros(F)) > least


def test_zoom_is_taken_out_and_nothing_else(small_scene: Scene) -> None:
    cameras = present(small_scene.cameras)
    still = at_one_scale(Cleaned(small_scene.tracks), small_scene.tracks, cameras)
    assert still.tracks is not None and (present(still.scales) == 1).all()
    np.testing.assert_array_equal(still.tracks, small_scene.tracks)
    tracks, factors = zoomed(small_scene)
    cleaned = at_one_scale(Cleaned(tracks), tracks, cameras)
    np.testing.assert_allclose(cleaned.tracks * present(cleaned.scales)[:, None, None], tracks)
    assert np.std(np.log(present(cleaned.scales) / factors)) < 0.03


@pytest.mark.data
@pytest.mark.parametrize("name", PAIRS)
def test_real_bodies_show_zoom_and_no_other_change_of_scale(name: str) -> None:
    """Also where bodies keep their own motion."""
    for words in ((), ("dataset.motion=native", "dataset.placement=[3,0,0]")):
        scene = load(name, *words)
        still = estimate_scales(scene.tracks, present(scene.cameras))
        assert not still.significant and still.gain < 0.06
    scene = load(name)
    factors = zoom_factors(scene.n_frames, 0.2, "smooth", 0)
    found = estimate_scales(scene.tracks * factors[:, None, None], present(scene.cameras))
    assert found.significant
    assert np.std(np.log(found.scales / factors)) < 0.04


@pytest.mark.data
@pytest.mark.parametrize("take", ["salsa_01", "salsa_02", "salsa_03", "salsa_04"])
def test_people_who_walk_about_are_no_zoom(take: str) -> None:
    """Nor are they with cameras from their tracks."""
    scene = load("two_person", f"dataset.take={take}")
    assert estimate_scales(scene.tracks, present(scene.cameras)).gain < 0.08
    assert not estimate_scales(scene.tracks, estimate_cameras(scene.tracks)).significant
