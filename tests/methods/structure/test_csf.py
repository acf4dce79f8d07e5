"""Column space fitting: its gradient, exact recovery, and the errors that its authors print."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.real.mocap_body import load_single
from nrsfm.harness.evaluate import metrics
from nrsfm.methods.base import MethodError, Observations, standardise
from nrsfm.methods.structure.csf import CSF, ColumnSpaces
from nrsfm.methods.structure.pta import PTA, trajectory_basis
from nrsfm.methods.structure.rotation import estimate_cameras
from tests.methods.parts import present


def smooth_shapes(n_frames: int, vectors: int, rank: int, n_points: int) -> np.ndarray:
    """A structure on ``rank`` shapes of falling size, each on ``vectors`` cosines."""
    rng = np.random.default_rng(0)
    C = trajectory_basis(n_frames, vectors) @ rng.standard_normal((vectors, rank)) / 2.0 ** np.arange(rank)
    C[:, 0] += 1
    S = (C @ rng.standard_normal((rank, 3 * n_points))).reshape(n_frames, 3, n_points)
    centred: np.ndarray = S - S.mean(axis=2, keepdims=True)
    return centred


@pytest.mark.parametrize("spaces", [1, 3])
def test_the_gradient_is_the_slope(spaces: int, rng: np.random.Generator) -> None:
    fit = ColumnSpaces(rng.standard_normal((20, 2, 8)), orbit(20, 13.0), 6, spaces)
    C, change = rng.standard_normal((2, 20, 3))
    _, gradient = fit.cost(C)
    h = 1e-5
    slope = (fit.cost(C + h * change)[0] - fit.cost(C - h * change)[0]) / (2 * h)
    assert np.sum(gradient * change) == pytest.approx(slope, rel=1e-6)


def test_spaces_are_fitted_by_least_squares(rng: np.random.Generator) -> None:
    """Each leaves a residual that no structure on its coefficients can lower."""
    fit = ColumnSpaces(rng.standard_normal((20, 2, 8)), orbit(20, 13.0), 6, 3)
    C = rng.standard_normal((20, 3))
    E = fit.W
    for k, step in enumerate(fit.fit(C)):
        B = step.shapes.reshape(3, 8)
        rest = E - fit.cameras @ (C[:, k, None, None] * B)
        np.testing.assert_allclose(step.rest.reshape(E.shape), rest, atol=1e-12)
        np.testing.assert_allclose(np.einsum("f,fij,fip->jp", C[:, k], fit.cameras, rest), 0, atol=1e-11)
        E = rest


def test_the_start_is_the_point_trajectory_approach(rng: np.random.Generator) -> None:
    R, W = orbit(30, 13.0), rng.standard_normal((30, 2, 8))
    start = ColumnSpaces(standardise(W).W, R, 10, 1).structure(trajectory_basis(30, 4))
    wanted = present(PTA(rank=4).reconstruct(Observations(W, R)).structure) / standardise(W).scale
    np.testing.assert_allclose(start - start.mean(axis=2, keepdims=True), wanted, atol=1e-9)


def test_smooth_shapes_come_back() -> None:
    """From the first cosines, though the coefficients are on three times as many."""
    R = orbit(60, 25.0)
    S = smooth_shapes(60, 6, 2, 12)
    found = present(CSF(rank=2, together=True).reconstruct(Observations(project(R, S), R)).structure)
    assert np.linalg.norm(found - S) < 1e-3 * np.linalg.norm(S)


@pytest.mark.parametrize("together", [True, False])
def test_the_objective_never_rises(together: bool) -> None:
    R = orbit(40, 9.0)
    values: list[float] = []
    observations = Observations(
        project(R, smooth_shapes(40, 8, 4, 10)), R, progress=lambda i, n, found: values.append(found["objective"])
    )
    CSF(rank=3, together=together, basis=0.2).reconstruct(observations)
    assert np.all(np.diff(values) <= 1e-12 * values[0])
    assert values[-1] < 0.5 * values[0]


@pytest.mark.parametrize("together", [True, False])
def test_turning_the_world_turns_the_structure(together: bool) -> None:
    A = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    R = orbit(40, 9.0)
    W = project(R, smooth_shapes(40, 8, 4, 10))
    one, other = (
        present(CSF(rank=3, together=together, max_iter=30).reconstruct(Observations(W, cameras)).structure)
        for cameras in (R, R @ A.T)
    )
    np.testing.assert_allclose(other, A @ one, atol=1e-5 * np.abs(one).max())


@pytest.mark.parametrize("rank", [0, 2.5, 31])
def test_ranks_that_cannot_be_are_refused(rank: Any) -> None:
    with pytest.raises(MethodError, match="rank"):
        CSF(rank=rank).reconstruct(Observations(np.random.default_rng(0).standard_normal((30, 2, 8)), orbit(30)))


@pytest.mark.data
@pytest.mark.parametrize(
    ("body", "K", "together", "printed", "metric"),
    [
        ("shark", 3, True, 0.0081, "e_3d_dai_cam"),
        ("yoga", 7, True, 0.1467, "e_3d_dai"),
        ("walking", 5, False, 0.1035, "e_3d_dai_cam"),
    ],
)
def test_published_errors(data_folder: Path, body: str, K: int, together: bool, printed: float, metric: str) -> None:
    """With BMM's cameras, which the authors did not have."""
    scene = load_single(data_folder, body)
    rank = {"shark": 4, "yoga": 10, "walking": 8}[body]
    method = CSF(rank=K, together=together)
    result = method.reconstruct(Observations(scene.tracks, estimate_cameras(scene.tracks, rank=rank)))
    assert metrics.evaluate(scene, result, known_cameras=False)[metric] == pytest.approx(printed, rel=0.1)
