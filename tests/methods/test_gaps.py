"""Tracks with gaps: exact translations, completion of low rank, and methods that do not depend on hidden positions."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.base import clone

from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import Array, Mask, Method, MethodError, Observations, standardise
from nrsfm.methods.clustering.edsc import EDSC
from nrsfm.methods.clustering.ssc import SSC
from nrsfm.methods.gaps import complete, fill, misfit
from nrsfm.methods.multibody.adaptive import AdaptiveMultiBody
from nrsfm.methods.multibody.printed import MultiBody
from nrsfm.methods.pipelines import ClusterThenReconstruct, ClusterTracks, ReconstructThenCluster
from nrsfm.methods.structure.bmm import BMM, fit_shape
from nrsfm.methods.structure.smooth_bmm import SmoothBMM
from tests.methods.parts import present

METHODS = [
    BMM(max_iter=60),
    BMM(l2=0.1, max_iter=60),
    SmoothBMM(max_iter=60),
    ClusterTracks(SSC()),
    ClusterTracks(EDSC(), standardise=False, projection=4),
    ReconstructThenCluster(BMM(max_iter=60), SSC()),
    ClusterThenReconstruct(SSC(), BMM(max_iter=60)),
    AdaptiveMultiBody(max_iter=20),
    MultiBody(max_iter=20),
]
NAMES = ["bmm", "bmm weighted", "smooth_bmm", "ssc2d", "edsc", "bmm_ssc3d", "ssc2d_bmm", "adaptive", "ours"]


@pytest.fixture
def visible(small_scene: Scene) -> Mask:
    return np.random.default_rng(5).random((small_scene.n_frames, small_scene.n_points)) > 0.2


def hidden(tracks: Array, visible: Mask, value: float = np.nan) -> Array:
    return np.where(visible[:, None], tracks, value)


def test_misfit_takes_the_best_translation(rng: np.random.Generator) -> None:
    """Frame by frame and axis by axis the residual of least squares on a constant."""
    W, X, seen = rng.standard_normal((4, 2, 9)), rng.standard_normal((4, 2, 9)), rng.random((4, 9)) > 0.3
    D = misfit(hidden(W, seen, 0.0), X, seen)
    for f in range(4):
        for axis in range(2):
            d = (W - X)[f, axis, seen[f]]
            t = np.linalg.lstsq(np.ones((len(d), 1)), d, rcond=None)[0]
            np.testing.assert_allclose(D[f, axis, seen[f]], d - t, atol=1e-12)
    assert (D[~np.broadcast_to(seen[:, None], D.shape)] == 0).all()
    moved = misfit(hidden(W + rng.standard_normal((4, 2, 1)), seen, 0.0), X, seen)
    np.testing.assert_allclose(moved, D, atol=1e-12)
    np.testing.assert_array_equal(misfit(W, X, None), W - X)


def test_fill_minimises_over_what_is_hidden(rng: np.random.Generator) -> None:
    W, X, seen = rng.standard_normal((4, 2, 9)), rng.standard_normal((4, 2, 9)), rng.random((4, 9)) > 0.3
    X -= X.mean(axis=2, keepdims=True)
    full = fill(hidden(W, seen, 0.0), X, seen)
    np.testing.assert_allclose(full.mean(axis=2), 0, atol=1e-12)
    apart = (W - full)[:, :, None] - (W - full)[:, :, :, None]
    both = np.broadcast_to((seen[:, None] & seen[:, :, None])[:, None], apart.shape)
    assert np.abs(apart[both]).max() < 1e-12  # visible points keep their places to each other
    np.testing.assert_allclose(full.transpose(0, 2, 1)[~seen], X.transpose(0, 2, 1)[~seen], atol=1e-12)


def rigid(n_frames: int = 40, n_points: int = 60) -> Array:
    """Tracks of two rigid bodies, which translate: of rank 6 once they are centred."""
    rng = np.random.default_rng(0)
    bodies = [rng.standard_normal((n_frames, 2, 3)) @ rng.standard_normal((3, n_points // 2)) for _ in range(2)]
    return np.concatenate(bodies, axis=2) + rng.standard_normal((n_frames, 2, 1))


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_completion_recovers_tracks_of_low_rank(share: float) -> None:
    W = rigid()
    seen = np.random.default_rng(1).random((40, 60)) >= share
    result = complete(hidden(W, seen), seen, tol=1e-8, max_iter=3000)
    assert np.abs(result - W).max() < 1e-4 * np.abs(W).max()
    np.testing.assert_array_equal(result.transpose(0, 2, 1)[seen], W.transpose(0, 2, 1)[seen])
    shift = np.random.default_rng(2).standard_normal((40, 2, 1))
    moved = complete(hidden(W + shift, seen), seen)
    np.testing.assert_allclose(moved - shift, complete(hidden(W, seen), seen), atol=1e-8)
    assert complete(W, None) is W


def test_shape_with_gaps_is_feasible_and_of_least_nuclear_norm(small_scene: Scene, visible: Mask) -> None:
    assert small_scene.cameras is not None
    R, data = small_scene.cameras, standardise(hidden(small_scene.tracks, visible), visible)
    fit = fit_shape(data.W, R, 0.0, visible, max_iter=20000, tol=1e-9)
    S = fit.structure
    assert np.abs(misfit(data.W, R @ S, visible)).max() < 1e-7
    np.testing.assert_allclose(S.mean(axis=2), 0, atol=1e-9)
    norm = np.linalg.norm(S.reshape(len(S), -1), "nuc")
    rng = np.random.default_rng(0)
    for _ in range(30):
        change = rng.standard_normal(S.shape) * 10.0 ** rng.uniform(-3, -1)
        change -= R.transpose(0, 2, 1) @ np.where(
            visible[:, None], R @ change, 0
        )  # hidden points and depths move freely
        change -= (R.transpose(0, 2, 1) @ R) @ change.mean(axis=2, keepdims=True) * 0
        assert np.linalg.norm((S + change).reshape(len(S), -1), "nuc") >= norm - 1e-5


@pytest.mark.parametrize("l2", [0.0, 0.2])
def test_a_mask_that_hides_nothing_changes_nothing(small_scene: Scene, l2: float) -> None:
    assert small_scene.cameras is not None
    everything = np.ones((small_scene.n_frames, small_scene.n_points), dtype=bool)
    for method in (BMM(l2=l2, max_iter=40), AdaptiveMultiBody(max_iter=15), MultiBody(max_iter=15)):
        whole = method.reconstruct(Observations(small_scene.tracks, small_scene.cameras), 2)
        masked = method.reconstruct(Observations(small_scene.tracks, small_scene.cameras, everything), 2)
        assert whole.structure is not None and masked.structure is not None
        np.testing.assert_allclose(masked.structure, whole.structure, atol=1e-7)


@pytest.mark.parametrize("method", METHODS, ids=NAMES)
def test_what_is_hidden_plays_no_part(small_scene: Scene, visible: Mask, method: Method) -> None:
    """NaN, zero or a huge number behind the mask: the same result."""
    assert small_scene.cameras is not None
    W, R = small_scene.tracks, small_scene.cameras
    results = [
        clone(method).reconstruct(Observations(hidden(W, visible, value), R, visible), 2)
        for value in (np.nan, 0.0, 1e9)
    ]
    for result in results[1:]:
        for name in ("structure", "labels", "affinity"):
            one, other = getattr(results[0], name), getattr(result, name)
            assert (one is None) == (other is None)
            if one is not None:
                np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("method", [BMM(tol=1e-6), MultiBody(max_iter=100)], ids=["bmm", "ours"])
def test_hidden_points_are_reconstructed(small_scene: Scene, visible: Mask, method: Method) -> None:
    """Their error is of the order of what the same method has without gaps, and far below that of knowing nothing."""
    assert small_scene.cameras is not None and small_scene.structure is not None
    W, R, truth = small_scene.tracks, small_scene.cameras, small_scene.structure
    whole = present(method.reconstruct(Observations(W, R), 2).structure)
    result = present(method.reconstruct(Observations(hidden(W, visible), R, visible), 2).structure)
    error, usual = (np.linalg.norm(S - truth, axis=1)[~visible].mean() for S in (result, whole))
    assert error < 3 * usual and error < 0.25 * np.linalg.norm(truth, axis=1)[~visible].mean()


def test_clusters_that_are_hidden_at_once(small_scene: Scene, visible: Mask) -> None:
    """A whole body behind something: every method but the shape of that body alone still knows the frame."""
    assert small_scene.cameras is not None and small_scene.labels is not None
    seen = visible | True
    seen[10:14, small_scene.labels == 1] = False
    for method in METHODS:
        tracks = hidden(small_scene.tracks, seen)
        result = clone(method).reconstruct(Observations(tracks, small_scene.cameras, seen), 2)
        assert result.structure is None or np.isfinite(result.structure).all()


def test_masks_that_see_too_little(small_scene: Scene, visible: Mask) -> None:
    W = small_scene.tracks
    for where, message in ((np.s_[3], "frame 3 is observed less"), (np.s_[:, 5], "track 5 is observed less")):
        dark = visible.copy()
        dark[where] = False
        for call in (standardise, complete, lambda tracks, seen: Observations(tracks, visible=seen)):
            with pytest.raises(MethodError, match=message):
                call(hidden(W, dark), dark)
    with pytest.raises(MethodError, match=r"visible \(4, 3\)"):
        standardise(W, np.ones((4, 3), dtype=bool))
    with pytest.raises(MethodError, match="visible tracks hold NaN"):
        standardise(hidden(W, visible), visible | True)
