"""The weighted nuclear norm: exact recovery, invariance, and the errors that its papers print."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.real.mocap_body import load_single
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate import metrics
from nrsfm.methods.base import MethodError, Observations
from nrsfm.methods.structure.rotation import estimate_cameras
from nrsfm.methods.structure.weighted_bmm import WeightedBMM
from tests.methods.parts import observed, present


@pytest.mark.parametrize("free", [0, 1, 2])
def test_a_structure_of_low_rank_comes_back(free: int) -> None:
    """With a mean shape and one mode, which the threshold lets in first."""
    rng = np.random.default_rng(1)
    F, P = 60, 30
    modes = np.stack([np.ones(F), 0.3 * np.cos(np.arange(F) / 9)], axis=1)
    S = (modes @ rng.standard_normal((2, 3 * P))).reshape(F, 3, P)
    S -= S.mean(axis=2, keepdims=True)
    R = orbit(F, 7.0)
    found = present(WeightedBMM(free=free).reconstruct(Observations(project(R, S), R)).structure)
    assert np.linalg.norm(found - S) < 2e-3 * np.linalg.norm(S)


def test_the_images_are_those_of_the_tracks(small_scene: Scene) -> None:
    """The growing penalty lets every singular value in at last."""
    found = present(WeightedBMM().reconstruct(observed(small_scene)).structure)
    off = project(present(small_scene.cameras), found) - small_scene.tracks
    assert np.linalg.norm(off) < 0.01 * np.linalg.norm(small_scene.tracks)


def test_turning_the_world_turns_the_structure(small_scene: Scene) -> None:
    A = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    R = present(small_scene.cameras)
    one = present(WeightedBMM().reconstruct(Observations(small_scene.tracks, R)).structure)
    other = present(WeightedBMM().reconstruct(Observations(small_scene.tracks, R @ A.T)).structure)
    np.testing.assert_allclose(other, A @ one, atol=1e-6 * np.abs(one).max())


def test_units_do_not_matter(small_scene: Scene) -> None:
    R = small_scene.cameras
    one = present(WeightedBMM().reconstruct(Observations(small_scene.tracks, R)).structure)
    other = present(WeightedBMM().reconstruct(Observations(100 * small_scene.tracks, R)).structure)
    np.testing.assert_allclose(other, 100 * one, atol=1e-6 * np.abs(other).max())


@pytest.mark.parametrize("free", [-1, 1.5])
def test_a_free_number_that_cannot_be_is_refused(free: int, small_scene: Scene) -> None:
    with pytest.raises(MethodError, match="free"):
        WeightedBMM(free=free).reconstruct(observed(small_scene))


@pytest.mark.data
@pytest.mark.parametrize(
    ("body", "K", "printed"), [("pickup", 12, 0.0152), ("yoga", 10, 0.0122), ("stretch", 11, 0.0124)]
)
def test_published_errors(data_folder: Path, body: str, K: int, printed: float) -> None:
    """Organic priors, ECCV 2022, table 2, which fits the error after a rotation of each frame."""
    scene = load_single(data_folder, body)
    result = WeightedBMM(free=1).reconstruct(Observations(scene.tracks, estimate_cameras(scene.tracks, rank=K)))
    found = metrics.evaluate(scene, result, known_cameras=False)["e_3d_procrustes"]
    assert found == pytest.approx(printed, rel=0.05)
