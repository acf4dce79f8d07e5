"""Metrics: published figures, invariances, and what they must not forgive."""

from __future__ import annotations

import csv
from dataclasses import replace
from importlib import resources
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate import errors, metrics
from nrsfm.harness.evaluate.alignment import align_polar, align_procrustes
from nrsfm.harness.evaluate.metric_type import NO_CAMERAS, needed
from nrsfm.methods.base import Reconstruction

#: Metrics of a structure before cameras that need no truth.
WITHOUT_TRUTH = {metric.name for metric in metrics.METRICS if metric.absent == NO_CAMERAS}


def stored() -> list[tuple[str, int, int, str, float]]:
    text = resources.files("nrsfm.reports.paper").joinpath("single_body.csv").read_text()
    return [
        (r["sequence"], int(r["frames"]), int(r["points"]), r["metric"], float(r["value"]))
        for r in csv.DictReader(text.splitlines())
        if r["method"] == "pta_stored"
    ]


@pytest.mark.data
@pytest.mark.parametrize(("sequence", "frames", "points", "metric", "value"), stored())
def test_stored_reconstructions_have_their_published_errors(
    data_folder: Path, sequence: str, frames: int, points: int, metric: str, value: float
) -> None:
    arrays = read_mat(data_folder / "mocap" / f"{sequence}.mat", ["S", "Shat"])
    truth, estimate = (arrays[name].reshape(frames, 3, points) for name in ("S", "Shat"))
    measured = getattr(errors, metric)(estimate, truth)
    assert round(measured, 4) == value
    if metric == "e_3d_dai":
        aligned = align_polar(estimate, truth)
        assert round(errors.e_3d_dai(aligned, truth), 4) == value


@pytest.mark.data
def test_procrustes_is_not_the_polar_rule(data_folder: Path) -> None:
    arrays = read_mat(data_folder / "mocap" / "pickup.mat", ["S", "Shat"])
    truth, estimate = (arrays[name].reshape(357, 3, 41) for name in ("S", "Shat"))
    assert round(errors.e_3d_dai(align_procrustes(estimate, truth), truth), 4) == 0.2222


def test_missegmentation_ignores_names() -> None:
    truth = np.repeat([0, 1, 2], [5, 7, 9])
    assert errors.n_wrong(np.array([4, 9, 1])[truth], truth) == 0
    wrong = truth.copy()
    wrong[[0, 6]] = 2
    assert errors.n_wrong(wrong, truth) == 2
    assert errors.n_wrong(np.array([1, 2, 0])[wrong], truth) == 2


def test_missegmentation_matches_a_slow_count(rng: np.random.Generator) -> None:
    from itertools import permutations

    for _ in range(20):
        truth, found = rng.integers(0, 4, 30), rng.integers(0, 4, 30)
        slow = min(int((np.array(p)[found] != truth).sum()) for p in permutations(range(4)))
        assert errors.n_wrong(found, truth) == slow


def test_merged_and_split_clusters_count() -> None:
    truth = np.repeat([0, 1], [6, 4])
    assert errors.n_wrong(np.zeros(10, int), truth) == 4
    assert errors.n_wrong(np.arange(10), truth) == 8


def test_unknown_truth_and_hidden_points_by_hand(small_scene: Scene, estimate: Reconstruction) -> None:
    """NaN in the truth: the metrics of what is left. Hidden points count in e_3d, and by themselves beside it."""
    assert small_scene.structure is not None and estimate.structure is not None
    visible = np.ones((small_scene.n_frames, small_scene.n_points), dtype=bool)
    visible[::3, 4], visible[:, 20] = False, np.arange(small_scene.n_frames) < 2
    W = np.where(visible[:, None], small_scene.tracks, np.nan)
    dropped = replace(small_scene, tracks=W, visible=visible)
    found = metrics.evaluate(dropped, estimate, known_cameras=True)
    whole = metrics.evaluate(small_scene, estimate, known_cameras=True)
    different = {"e_3d_visible", "e_3d_hidden"} | WITHOUT_TRUTH
    assert {k: v for k, v in found.items() if k not in different} == {
        k: v for k, v in whole.items() if k not in different
    }
    S, truth = (X - X.mean(axis=2, keepdims=True) for X in (estimate.structure, small_scene.structure))
    for name, part in (("visible", visible), ("hidden", ~visible)):
        errors = [
            np.linalg.norm((S - truth)[f][:, part[f]]) / np.linalg.norm(truth[f][:, part[f]])
            for f in range(len(S))
            if part[f].any()
        ]
        assert found[f"e_3d_{name}"] == pytest.approx(np.mean(errors))
    unknown = replace(dropped, structure=np.where(visible[:, None], small_scene.structure, np.nan))
    found = metrics.evaluate(unknown, estimate, known_cameras=True)
    assert "e_3d_hidden" not in found
    errors, distances, spreads = [], [], []
    for f in range(len(S)):
        A, B = (X[f][:, visible[f]] for X in (estimate.structure, small_scene.structure))
        A, B = (X - X.mean(axis=1, keepdims=True) for X in (A, B))
        errors.append(np.linalg.norm(A - B) / np.linalg.norm(B))
        distances += list(np.linalg.norm(A - B, axis=0))
        spreads.append(B.std(axis=1))
    assert found["e_3d"] == found["e_3d_visible"] == pytest.approx(np.mean(errors))
    assert found["e_3d_dai"] == pytest.approx(np.mean(distances) / np.mean(spreads))
    exact = replace(estimate, structure=small_scene.structure)
    right = metrics.evaluate(unknown, exact, known_cameras=False)
    errors_alone = {k: v for k, v in right.items() if k.startswith("e_3d") or k == "reprojection"}
    assert len(errors_alone) > 8 and max(errors_alone.values()) < 1e-12


def test_unequal_numbers_of_clusters_and_bodies(rng: np.random.Generator) -> None:
    """The best one-to-one assignment by trying all; clusters without a body are wrong."""
    for found, true in ((2, 4), (4, 2), (1, 3), (3, 1), (5, 3)):
        estimate, truth = rng.integers(0, found, 30), rng.integers(0, true, 30)
        estimate[:found], truth[:true] = range(found), range(true)
        most = max(found, true)
        right = max(int((np.array(names)[estimate] == truth).sum()) for names in permutations(range(most)))
        assert errors.n_wrong(estimate, truth) == 30 - right


def test_counts(small_scene: Scene) -> None:
    assert small_scene.labels is not None
    A = (small_scene.labels[:, None] == small_scene.labels).astype(float)
    right = Reconstruction(labels=1 - small_scene.labels, affinity=A)
    assert count(small_scene, right) == {
        "n_bodies_found": 2,
        "miscounted": 0,
        "eigengap": pytest.approx(1 + 1 / 14),
    }
    one = count(small_scene, replace(right, labels=np.zeros(30, dtype=int)))
    assert (one["n_bodies_found"], one["miscounted"], round(one["eigengap"], 9)) == (1, 1, 0)
    assert count(small_scene, Reconstruction()) == {}
    assert "miscounted" not in count(replace(small_scene, labels=None), right)
    assert not metrics.evaluate(small_scene, right, known_cameras=True).keys() & count(small_scene, right).keys()


def count(scene: Scene, found: Reconstruction) -> dict[str, float]:
    """The metrics that are logged only where the number of bodies was left to the method."""
    values = metrics.evaluate(scene, found, known_cameras=True, counted=True)
    return {name: value for name, value in values.items() if metrics.BY_NAME[name].counted}


@pytest.fixture
def estimate(small_scene: Scene, rng: np.random.Generator) -> Reconstruction:
    truth = needed(small_scene.structure)
    S = truth + 0.1 * rng.standard_normal(truth.shape)
    S -= S.mean(axis=2, keepdims=True)
    return Reconstruction(structure=S, cameras=small_scene.cameras, labels=small_scene.labels)


def test_estimated_cameras_are_judged_up_to_one_orthogonal_matrix(
    small_scene: Scene, estimate: Reconstruction, rng: np.random.Generator
) -> None:
    Q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    turned = replace(estimate, structure=Q @ estimate.structure, cameras=estimate.cameras @ Q.T)
    plain = metrics.evaluate(small_scene, estimate, known_cameras=False)
    moved = metrics.evaluate(small_scene, turned, known_cameras=False)
    assert plain.keys() == moved.keys()
    for name in plain.keys() - {"e_3d_dai_cam"}:
        assert moved[name] == pytest.approx(plain[name], abs=1e-9), name
    assert moved["e_3d_dai_cam"] == pytest.approx(plain["e_3d_dai_cam"], rel=0.02)


@pytest.mark.parametrize("known", [True, False])
def test_e_3d_is_the_mean_of_its_frames(
    small_scene: Scene, estimate: Reconstruction, rng: np.random.Generator, known: bool
) -> None:
    Q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    turned = replace(estimate, structure=Q @ estimate.structure, cameras=estimate.cameras @ Q.T)
    frames = metrics.by_frame(small_scene, turned, known_cameras=known)
    assert frames["frame_e_3d"].shape == (len(small_scene.tracks),)
    expected = metrics.evaluate(small_scene, turned, known_cameras=known)["e_3d"]
    assert frames["frame_e_3d"].mean() == pytest.approx(expected)
    if known:
        np.testing.assert_array_equal(frames["alignment"], np.eye(3))


def test_known_cameras_forgive_no_rotation(small_scene: Scene, estimate: Reconstruction) -> None:
    flipped = replace(estimate, structure=-needed(estimate.structure))
    assert metrics.evaluate(small_scene, flipped, known_cameras=True)["e_3d"] > 1.5
    assert metrics.evaluate(small_scene, flipped, known_cameras=False)["e_3d"] < 0.3


def test_the_truth_has_no_error(small_scene: Scene) -> None:
    truth = Reconstruction(
        structure=small_scene.structure, cameras=small_scene.cameras, labels=1 - needed(small_scene.labels)
    )
    for known in (True, False):
        values = metrics.evaluate(small_scene, truth, known_cameras=known)
        assert max(value for name, value in values.items() if metrics.BY_NAME[name.rstrip("_01")].better) < 1e-9
        assert {"e_3d", "e_3d_dai", "e_3d_centred", "e_3d_body_0", "e_3d_body_1", "e_ms", "n_wrong"} <= values.keys()


def test_definitions_by_hand(small_scene: Scene, estimate: Reconstruction) -> None:
    S, T = needed(estimate.structure), needed(small_scene.structure)
    frames = [np.linalg.norm(S[f] - T[f]) / np.linalg.norm(T[f]) for f in range(len(T))]
    assert errors.e_3d(S, T) == pytest.approx(np.mean(frames))
    stds = [np.std(T[f, i]) for f in range(len(T)) for i in range(3)]
    gaps = [np.linalg.norm(S[f, :, p] - T[f, :, p]) for f in range(len(T)) for p in range(T.shape[2])]
    assert errors.e_3d_dai(S, T) == pytest.approx(np.mean(gaps) / np.mean(stds))


def test_what_is_absent_is_left_out(small_scene: Scene) -> None:
    labels_only = metrics.evaluate(small_scene, Reconstruction(labels=small_scene.labels), known_cameras=True)
    assert labels_only == {"n_wrong": 0.0, "e_ms": 0.0}
    blind = replace(small_scene, structure=None, labels=None)
    found = Reconstruction(structure=small_scene.structure, cameras=small_scene.cameras, labels=small_scene.labels)
    assert metrics.evaluate(blind, found, known_cameras=True).keys() == WITHOUT_TRUTH


def test_affinity_between_bodies() -> None:
    truth = np.repeat([0, 1], 3)
    block = np.kron(np.eye(2), np.ones((3, 3)))
    assert errors.affinity_between(block, truth) == 0
    assert errors.affinity_between(1 - block, truth) == 1
