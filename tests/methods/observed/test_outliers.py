"""Outliers and jumps: found where they are, none on clean tracks, whatever the camera and the units."""

from __future__ import annotations

import numpy as np
import pytest

from nrsfm.datasets.corruption import corrupt
from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import Array, Cleaned, Mask
from nrsfm.methods.gaps import complete
from nrsfm.methods.observed.cleaning import without_outliers
from nrsfm.methods.observed.outliers import PAIRS as NEIGHBOURS
from nrsfm.methods.observed.outliers import distances, find_outliers
from tests.conftest import PAIRS
from tests.methods.observed.parts import load
from tests.methods.parts import present


def rigid(scene: Scene) -> Array:
    """Tracks of a rigid scene before a camera that turns, shifts and zooms, a random amount each frame."""
    rng = np.random.default_rng(7)
    tracks = present(scene.cameras) @ present(scene.structure)[0]
    return np.asarray(rng.uniform(0.7, 1.3, (len(tracks), 1, 1)) * tracks + rng.standard_normal((len(tracks), 2, 1)))


def spoiled(tracks: Array, share: float, seed: int = 0) -> tuple[Array, Mask]:
    """Tracks with some observations moved by their whole spread, and which."""
    rng = np.random.default_rng(seed)
    bad = rng.random((len(tracks), tracks.shape[2])) < share
    angle = rng.uniform(0, 2 * np.pi, bad.shape)
    step = 2 * np.nanstd(tracks) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.where(bad[:, None], tracks + step, tracks), bad


def test_two_images_of_a_rigid_scene_predict_a_third(small_scene: Scene) -> None:
    X = rigid(small_scene).transpose(0, 2, 1)
    X = (X - X.mean(axis=1, keepdims=True)) / X.std(axis=(1, 2), keepdims=True)
    seen = np.ones(X.shape[:2], bool)
    lines, fitted = distances(X, seen, None), distances(X, seen, seen.astype(float))
    for k, (a, b) in enumerate(NEIGHBOURS):
        inside = slice(max(0, -a), len(X) - max(0, b))
        assert fitted[k, inside].mean() < 0.05 * lines[k, inside].mean()
        assert np.isinf(fitted[k, : max(0, -a)]).all() and np.isinf(fitted[k, len(X) - max(0, b) :]).all()


@pytest.mark.parametrize("share", [0.0, 0.01, 0.05])
def test_outliers_are_found_and_nothing_else(small_scene: Scene, share: float) -> None:
    tracks, bad = spoiled(rigid(small_scene), share)
    found = find_outliers(tracks)
    assert not (bad & ~found).any()
    assert (found & ~bad).sum() <= 0.5 * bad.sum()


def test_deforming_bodies_are_no_outliers(small_scene: Scene) -> None:
    assert not find_outliers(small_scene.tracks).any()


def test_outliers_depend_on_no_units_order_or_zoom(small_scene: Scene, rng: np.random.Generator) -> None:
    tracks, _ = spoiled(small_scene.tracks, 0.05)
    expected = find_outliers(tracks)
    order = rng.permutation(small_scene.n_points)
    moved = rng.uniform(0.5, 2, (len(tracks), 1, 1)) * tracks + rng.standard_normal((len(tracks), 2, 1))
    assert expected.any()
    np.testing.assert_array_equal(find_outliers(moved), expected)
    np.testing.assert_array_equal(find_outliers(tracks[:, :, order]), expected[:, order])
    np.testing.assert_array_equal(find_outliers(tracks[::-1])[::-1], expected)


def test_hidden_positions_play_no_part(small_scene: Scene, rng: np.random.Generator) -> None:
    tracks, _ = spoiled(small_scene.tracks, 0.05)
    visible = rng.random(tracks[:, 0].shape) > 0.1
    results = [find_outliers(np.where(visible[:, None], tracks, value), visible) for value in (np.nan, 0.0, 1e3)]
    assert results[0].any() and not (results[0] & ~visible).any()
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


@pytest.mark.parametrize("start", [10, 20])
def test_of_a_track_that_jumps_the_longer_part_is_kept(small_scene: Scene, start: int) -> None:
    tracks = small_scene.tracks.copy()
    F = len(tracks)
    far = int(np.argmax(np.linalg.norm(tracks - tracks[:, :, :1], axis=1).min(axis=0)))
    tracks[start:, :, 0] = tracks[start:, :, far]
    found = find_outliers(tracks)
    wrong = np.arange(F) >= start if start > F / 2 else np.arange(F) < start
    np.testing.assert_array_equal(found[:, 0], wrong)
    assert found[:, 1:].sum() <= 1


def test_outliers_become_gaps(small_scene: Scene) -> None:
    tracks, bad = spoiled(small_scene.tracks, 0.02)
    cleaned = without_outliers(Cleaned(tracks))
    assert present(cleaned.outliers)[bad].all()
    np.testing.assert_array_equal(present(cleaned.visible), ~present(cleaned.outliers))
    np.testing.assert_array_equal(np.isnan(cleaned.tracks[:, 0]), present(cleaned.outliers))
    whole = complete(cleaned.tracks, cleaned.visible)
    error, size = (np.linalg.norm((X - small_scene.tracks).transpose(0, 2, 1)[bad]) for X in (whole, tracks))
    assert error < 0.1 * size
    clean = without_outliers(Cleaned(small_scene.tracks))
    assert clean.visible is None and clean.tracks is small_scene.tracks


def test_short_tracks_and_points_at_rest_are_no_outliers(small_scene: Scene) -> None:
    """A point that begins to move a little among points that stand still; a track that is seen in three frames."""
    tracks = small_scene.tracks[:1] + np.zeros((len(small_scene.tracks), 1, 1))
    tracks[10:, 0, 3] += 1e-3 * np.std(tracks)
    assert not find_outliers(tracks).any()
    tracks, visible = small_scene.tracks.copy(), np.ones(small_scene.tracks[:, 0].shape, bool)
    visible[3:, 5] = False
    assert not find_outliers(tracks, visible).any()


def test_every_track_keeps_two_observations(small_scene: Scene, rng: np.random.Generator) -> None:
    tracks, visible = small_scene.tracks.copy(), np.ones(small_scene.tracks[:, 0].shape, bool)
    visible[4:, 5] = False
    tracks[:4, :, 5] = 5 * rng.standard_normal((4, 2))
    kept = visible & ~find_outliers(tracks, visible)
    assert kept.sum(axis=0).min() >= 2


@pytest.mark.data
@pytest.mark.parametrize("name", PAIRS)
def test_real_bodies(name: str) -> None:
    """Next to nothing is flagged on clean and on noisy tracks; outliers are found, those that are far off."""
    scene = load(name)
    for tracks in (scene.tracks, scene.with_noise(0.01).tracks, scene.with_noise(0.05).tracks):
        assert find_outliers(tracks).mean() < 5e-4
    tracks = corrupt(scene.tracks, scene.name, outliers=0.05)
    bad = (tracks != scene.tracks).any(axis=1)
    found = find_outliers(tracks)
    off = np.linalg.norm(tracks - scene.tracks, axis=1)
    assert np.sum(off[bad & ~found] ** 2) < 1e-3 * np.sum(off**2)
    assert (found & ~bad).sum() < 0.005 * bad.size
