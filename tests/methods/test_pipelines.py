"""The two-stage pipelines, rotation from tracks, and the registry."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
import pytest
from numpy.typing import ArrayLike

from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate import errors
from nrsfm.methods.base import Method, MethodError, Observations, standardise
from nrsfm.methods.clustering.ssc import SSC
from nrsfm.methods.pipelines import ClusterThenReconstruct, ClusterTracks, ReconstructThenCluster, lift, principal
from nrsfm.methods.registry import ALGORITHMS, build, build_method, version
from nrsfm.methods.structure.bmm import BMM
from nrsfm.methods.structure.rotation import estimate_cameras, orthonormal_rows
from tests.methods.parts import observed, present

Pipelines = Mapping[str, Method]


@pytest.fixture(scope="module")
def pipelines() -> Pipelines:
    return {
        "tracks": ClusterTracks(SSC(share=0.7)),
        "3d": ReconstructThenCluster(BMM(), SSC(share=0.7)),
        "2d": ClusterThenReconstruct(SSC(share=0.7), BMM()),
    }


@pytest.mark.parametrize("name", ["tracks", "3d", "2d"])
def test_pipelines_give_what_they_promise(small_scene: Scene, pipelines: Pipelines, name: str) -> None:
    method = pipelines[name]
    tracks = small_scene.tracks.copy()
    result = method.reconstruct(Observations(tracks, small_scene.cameras), 2)
    assert (tracks == small_scene.tracks).all()
    assert (result.structure is not None) == ("structure" in method.provides)
    labels = present(result.labels)
    assert labels.shape == (small_scene.n_points,)
    again = method.reconstruct(Observations(tracks, small_scene.cameras), 2)
    np.testing.assert_array_equal(present(again.labels), labels)


@pytest.mark.parametrize("name", ["tracks", "3d", "2d"])
def test_permuting_tracks_permutes_the_result(
    small_scene: Scene, pipelines: Pipelines, name: str, rng: np.random.Generator
) -> None:
    order = rng.permutation(small_scene.n_points)
    plain = pipelines[name].reconstruct(observed(small_scene), 2)
    mixed = pipelines[name].reconstruct(Observations(small_scene.tracks[:, :, order], small_scene.cameras), 2)
    assert errors.n_wrong(present(mixed.labels), present(plain.labels)[order]) == 0
    if plain.structure is not None:
        np.testing.assert_allclose(present(mixed.structure), plain.structure[:, :, order], atol=1e-5)


class Recorder(SSC):
    """Keeps its samples."""

    samples: np.ndarray

    def fit(self, X: ArrayLike, y: object = None) -> Self:
        Recorder.samples = np.asarray(X)
        return super().fit(X, y)


def test_tracks_are_clustered_standardised_or_as_they_are(rng: np.random.Generator) -> None:
    tracks = 3 + 5 * rng.standard_normal((6, 2, 10))
    ClusterTracks(Recorder()).reconstruct(Observations(tracks), 2)
    np.testing.assert_array_equal(Recorder.samples, standardise(tracks).W.reshape(12, 10).T)
    ClusterTracks(Recorder(), standardise=False).reconstruct(Observations(tracks), 2)
    np.testing.assert_array_equal(Recorder.samples, tracks.reshape(12, 10).T)


def test_standardised_tracks_have_no_unit_and_no_place(small_scene: Scene) -> None:
    there = 7 + 1000 * small_scene.tracks
    for method in (ClusterTracks(SSC(share=0.7)), ClusterTracks(SSC(share=0.7), projection=4)):
        here, moved = (method.reconstruct(Observations(W), 2) for W in (small_scene.tracks, there))
        np.testing.assert_allclose(np.asarray(moved.affinity), np.asarray(here.affinity), atol=1e-6)


def test_projection_is_the_best_of_its_dimension_and_not_centred(rng: np.random.Generator) -> None:
    W = 10 + rng.standard_normal((6, 2, 20))
    X = W.reshape(12, 20)
    Y = principal(W, 4)
    assert Y.shape == (4, 20)
    s = np.linalg.svd(X, compute_uv=False)
    U = np.linalg.lstsq(Y.T, X.T, rcond=None)[0].T
    assert np.linalg.norm(X - U @ Y) == pytest.approx(np.linalg.norm(s[4:]))
    np.testing.assert_allclose(U.T @ U, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(principal(W, 99).T @ principal(W, 99), X.T @ X, atol=1e-9)


def test_projection_is_to_dimensions_a_body(rng: np.random.Generator) -> None:
    tracks = rng.standard_normal((20, 2, 30))
    for n_bodies in (2, 3):
        ClusterTracks(Recorder(), standardise=False, projection=4).reconstruct(Observations(tracks), n_bodies)
        np.testing.assert_allclose(Recorder.samples, principal(tracks, 4 * n_bodies).T)
    wrongs: list[Any] = [0, -1, 1.5]
    for wrong in wrongs:
        with pytest.raises(MethodError, match="whole number"):
            ClusterTracks(SSC(), projection=wrong).reconstruct(Observations(tracks), 2)


def test_clusters_are_placed_where_they_are() -> None:
    """Two rigid bodies apart by a constant offset: with the right labels the whole scene comes back."""
    rng = np.random.default_rng(2)
    F, P = 90, 12
    S = np.concatenate(
        [np.tile(rng.standard_normal((1, 3, P)), (F, 1, 1)) + k * np.array([[4.0], [1.0], [2.0]]) for k in (0, 1)], 2
    )
    S -= S.mean(axis=2, keepdims=True)
    S *= 1 + 0.2 * np.sin(np.arange(F) / 5)[:, None, None] * (np.arange(2 * P) >= P)
    S -= S.mean(axis=2, keepdims=True)
    R = orbit(F)
    result = ClusterThenReconstruct(SSC(share=0.7), BMM(tol=1e-7), trajectory_order=1).reconstruct(
        Observations(project(R, S), R), 2
    )
    assert errors.n_wrong(present(result.labels), np.repeat([0, 1], P)) == 0


def test_lift_is_exact_on_its_basis() -> None:
    F = 80
    R = orbit(F)
    t = (np.arange(F) + 0.5) * np.pi / F
    path = np.stack([1 + 0 * t, 2 * np.cos(t), 3 - np.cos(2 * t)], axis=1)
    np.testing.assert_allclose(lift(np.einsum("fij,fj->fi", R, path), R, 3), path, atol=1e-9)
    with pytest.raises(MethodError, match="trajectory_order"):
        lift(np.zeros((F, 2)), R, 0)


def test_cameras_of_a_rigid_scene_are_found() -> None:
    rng = np.random.default_rng(5)
    S = np.tile(rng.standard_normal((1, 3, 20)), (50, 1, 1))
    R = orbit(50, 4.0)
    tilt = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    assert errors.e_r(estimate_cameras(project(R, S)), R) < 1e-8
    assert errors.e_r(estimate_cameras(project(R @ tilt, S)), R @ tilt) < 1e-8


def test_cameras_of_flat_scenes_are_refused() -> None:
    rng = np.random.default_rng(5)
    flat = project(orbit(30), np.tile(rng.standard_normal((1, 3, 10)) * [[[1], [1], [0]]], (30, 1, 1)))
    with pytest.raises(MethodError, match="rank less than 3"):
        estimate_cameras(flat)
    with pytest.raises(MethodError, match="at least 3"):
        estimate_cameras(np.ones((2, 2, 9)) * np.arange(9))


def test_orthonormal_rows_keep_their_sign() -> None:
    R = orbit(20)
    flipped = R * np.where(np.arange(20) % 3 == 1, -1.0, 1.0)[:, None, None]
    np.testing.assert_allclose(orthonormal_rows(2 * flipped), R, atol=1e-12)


def test_registry_builds_nested_methods() -> None:
    settings = {
        "algorithm": "cluster_then_reconstruct",
        "clusterer": {"algorithm": "ssc", "share": 0.7},
        "reconstructor": {"algorithm": "bmm"},
    }
    method = build_method(settings)
    assert method.get_params()["clusterer__share"] == 0.7
    assert version(method) == "cluster_then_reconstruct:1 ssc:1 bmm:1"


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"algorithm": "magic"}, "magic"),
        ({}, "None"),
        ({"algorithm": "adaptive", "l3": 1}, "l3"),
        ({"algorithm": "cluster_tracks"}, "clusterer"),
        ({"algorithm": "ssc"}, "part of methods"),
    ],
)
def test_registry_names_what_is_wrong(settings: dict[str, Any], word: str) -> None:
    with pytest.raises(MethodError, match=word):
        build_method(settings)


def test_every_algorithm_round_trips_its_parameters() -> None:
    for name, kind in ALGORITHMS.items():
        parts = {"clusterer": SSC(), "reconstructor": BMM()}
        needed = {k: v for k, v in parts.items() if k in kind.__init__.__code__.co_varnames}
        model = kind(**needed)
        again = build({"algorithm": name, **model.get_params(deep=False)})
        assert again.get_params().keys() == model.get_params().keys()


@pytest.mark.parametrize("name", ["tracks", "3d", "2d"])
def test_memory_grows_with_the_square_of_the_tracks(pipelines: Pipelines, name: str) -> None:
    few, many = (present(pipelines[name].memory(99, n)) for n in (1000, 10_000))
    assert 70 * few < many <= 100 * few
    assert present(pipelines[name].memory(10, 28_880)) > 60 * 2**30
