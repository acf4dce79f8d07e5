"""Wrong tracks of the eight pairs beside those that the clusterers' own authors' programs leave on the same tracks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nrsfm.datasets.real.mocap import load_scene
from nrsfm.harness.evaluate.errors import n_wrong
from nrsfm.methods.base import standardise
from nrsfm.methods.clustering.clusterer import SubspaceClusterer
from nrsfm.methods.clustering.edsc import EDSC
from nrsfm.methods.clustering.ssc import SSC
from nrsfm.methods.clustering.ssc_omp import SSCOMP
from tests.conftest import PAIRS

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def tracks(data_folder: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """The tracks of every pair, (P, 2F), and their bodies."""
    scenes = [load_scene(data_folder, pair.split("_"), registration="procrustes") for pair in PAIRS]
    return [(standardise(s.tracks).W.reshape(-1, s.n_points).T, np.asarray(s.labels)) for s in scenes]


def wrong(clusterer: SubspaceClusterer, tracks: list[tuple[np.ndarray, np.ndarray]]) -> list[int]:
    return [n_wrong(clusterer.fit(X).labels_, labels) for X, labels in tracks]


@pytest.mark.parametrize(
    ("clusterer", "theirs"),
    [
        (SSC(2), [7, 0, 50, 44, 2, 2, 54, 10]),
        (EDSC(2, cut="rotation"), [52, 0, 0, 48, 2, 2, 64, 7]),
    ],
)
def test_as_many_as_the_authors_program(
    clusterer: SubspaceClusterer, theirs: list[int], tracks: list[tuple[np.ndarray, np.ndarray]]
) -> None:
    assert wrong(clusterer, tracks) == theirs


def test_zeroed_diagonal_within_a_track_of_the_authors_program(tracks: list[tuple[np.ndarray, np.ndarray]]) -> None:
    theirs = np.array([0, 0, 0, 0, 21, 2, 0, 0])
    assert np.abs(wrong(SSC(2, share=0.7, diagonal="zeroed"), tracks) - theirs).max() <= 1
    assert wrong(SSC(2, share=0.7), tracks)[PAIRS.index("walking_yoga")] == 40


def test_matching_pursuit_leaves_as_many_in_all(tracks: list[tuple[np.ndarray, np.ndarray]]) -> None:
    assert sum(wrong(SSCOMP(2), tracks)) == 249


@pytest.mark.parametrize(
    ("settings", "expected"),
    [({}, [52, 35, 0, 30, 21, 2, 0, 7]), ({"dimension": 15, "weight": 10.0}, [0, 0, 0, 0, 11, 0, 9, 0])],
)
def test_edsc_of_rigid_and_of_deforming_bodies(
    settings: dict[str, float], expected: list[int], tracks: list[tuple[np.ndarray, np.ndarray]]
) -> None:
    """The authors' setting for motion and that for deforming bodies, both cut by k-means."""
    model = EDSC(2).set_params(**settings)
    assert wrong(model, tracks) == expected
