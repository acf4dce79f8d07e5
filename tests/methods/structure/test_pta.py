"""The point trajectory approach: exact where its model is, and the stored reconstructions of its authors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.generated import procedural
from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.datasets.real.mocap_body import load_single
from nrsfm.harness.evaluate import metrics
from nrsfm.methods.base import MethodError, Observations
from nrsfm.methods.structure.pta import GAPS, PTA, fit_trajectories, trajectory_basis
from nrsfm.methods.structure.rotation import estimate_cameras
from tests.methods.parts import present


def on_basis(n_frames: int, rank: int, n_points: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    S = np.einsum("fk,kjp->fjp", trajectory_basis(n_frames, rank), rng.standard_normal((rank, 3, n_points)))
    centred: np.ndarray = S - S.mean(axis=2, keepdims=True)
    return centred


def test_the_basis_is_the_cosine_transform() -> None:
    F, K = 20, 6
    Theta = trajectory_basis(F, K)
    np.testing.assert_allclose(Theta.T @ Theta, np.eye(K), atol=1e-12)
    k, t = np.arange(1, K), np.arange(F)[:, None]
    np.testing.assert_allclose(Theta[:, 0], F**-0.5)
    np.testing.assert_allclose(Theta[:, 1:], np.sqrt(2 / F) * np.cos(np.pi * (2 * t + 1) * k / (2 * F)), atol=1e-12)


def test_trajectories_on_the_basis_come_back() -> None:
    """With a camera that turns faster than they move."""
    R = orbit(60, 25.0)
    S = on_basis(60, 4, 10)
    result = PTA(rank=4).reconstruct(Observations(project(R, S), R))
    np.testing.assert_allclose(present(result.structure), S, atol=1e-9)


def test_it_is_the_least_squares_fit(rng: np.random.Generator) -> None:
    """The residual is orthogonal to every structure on the basis, eq. (7)."""
    R = orbit(30, 13.0)
    W = rng.standard_normal((30, 2, 8))
    rest = R.transpose(0, 2, 1) @ (W - R @ fit_trajectories(W, R, 5))
    np.testing.assert_allclose(np.einsum("fk,fjp->kjp", trajectory_basis(30, 5), rest), 0, atol=1e-9)


def test_in_gaps_velocities_count(rng: np.random.Generator) -> None:
    """The gradient of |W - R S|^2 over the visible rows and GAPS k^2 |a_k|^2 vanishes."""
    R = orbit(30, 13.0)
    W = rng.standard_normal((30, 2, 8))
    visible = rng.random((30, 8)) > 0.3
    S = fit_trajectories(W, R, 5, visible)
    Theta = trajectory_basis(30, 5)
    rest = R.transpose(0, 2, 1) @ np.where(visible[:, None], W - R @ S, 0)
    A = np.einsum("fk,fjp->kjp", Theta, S)
    pull = GAPS * np.arange(5)[:, None, None] ** 2 * A
    np.testing.assert_allclose(np.einsum("fk,fjp->kjp", Theta, rest), pull, atol=1e-9)


def test_a_track_half_unseen_stays_in_its_place() -> None:
    """Over half of the frames the cosines are nearly dependent: without the term e_3d is 6e6 here."""
    scene = procedural.load_scene(["person", "face"], 15, 40, 0, name="two", placement="paper")
    visible = np.ones((40, 30), dtype=bool)
    visible[20:, 4] = False
    scene = replace(scene, tracks=np.where(visible[:, None], scene.tracks, np.nan), visible=visible)
    found = PTA().reconstruct(Observations(scene.tracks, scene.cameras, visible))
    errors = metrics.evaluate(scene, found, known_cameras=True)
    assert errors["e_3d"] < 0.15 and errors["e_3d_hidden"] < 0.25 and errors["reprojection"] < 0.03


@pytest.mark.parametrize("rank", [0, -1, 2.5, 31, None])
def test_ranks_that_cannot_be_are_refused(rank: Any) -> None:
    with pytest.raises(MethodError, match="rank"):
        PTA(rank=rank).reconstruct(Observations(np.random.default_rng(0).standard_normal((30, 2, 8)), orbit(30)))


@pytest.mark.data
@pytest.mark.parametrize(
    ("body", "K", "published", "metric"), [("drink", 13, 0.0250, "e_3d_dai"), ("dance", 5, 0.2956, "e_3d_dai_cam")]
)
def test_published_errors(data_folder: Path, body: str, K: int, published: float, metric: str) -> None:
    """With rotations of the same K. Dance is stored in the camera's frame."""
    scene = load_single(data_folder, body)
    result = PTA(rank=K).reconstruct(Observations(scene.tracks, estimate_cameras(scene.tracks, rank=K)))
    assert metrics.evaluate(scene, result, known_cameras=False)[metric] == pytest.approx(published, rel=0.01)


@pytest.mark.data
@pytest.mark.parametrize("body", ["drink", "pickup", "yoga", "stretch"])
def test_stored_reconstructions_lie_on_the_basis(data_folder: Path, body: str) -> None:
    """The authors' own results, Shat (3F, P), are trajectories on the first K vectors, K as stored, to rounding."""
    fields = read_mat(data_folder / f"mocap/{body}.mat", ["Shat", "K"])
    K = int(fields["K"].item())
    stored = fields["Shat"].reshape(len(fields["Shat"]) // 3, -1)
    Theta = trajectory_basis(len(stored), K)
    assert np.linalg.norm(stored - Theta @ (Theta.T @ stored)) < 1e-8 * np.linalg.norm(stored)
    assert np.linalg.norm(stored - Theta[:, :-1] @ (Theta[:, :-1].T @ stored)) > 1e-3 * np.linalg.norm(stored)
