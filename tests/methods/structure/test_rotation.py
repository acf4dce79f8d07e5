"""Cameras from tracks alone: proof of optimality, exact recovery, derivatives, published numbers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.real.mocap import load_scene
from nrsfm.datasets.real.mocap_body import load_single
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate import errors, metrics
from nrsfm.methods.base import Array, MethodError, Observations, standardise
from nrsfm.methods.structure.bmm import BMM
from nrsfm.methods.structure.rotation import (
    STARTS,
    WEIGHTS,
    constraints,
    estimate_cameras,
    factor,
    fit_gram,
    jacobian,
    metric_upgrade,
    orthonormal_rows,
    refine,
    residuals,
    smat,
    svec,
)
from nrsfm.reports.layouts import published
from tests.methods.parts import present

RANKS = {"drink": 12, "pickup": 12, "yoga": 10, "stretch": 11, "dance": 10, "face": 7, "walking": 8, "shark": 4}
AKHTER = ("drink", "pickup", "yoga", "stretch")


def non_rigid(K: int, n_frames: int = 80, n_points: int = 40, seed: int = 0) -> tuple[Array, Array]:
    """Tracks and cameras of K shapes, the first the largest, before a tilted orbiting camera: exactly of rank 3K."""
    rng = np.random.default_rng(seed)
    shapes = rng.standard_normal((K, 3 * n_points)) * 0.6 ** np.arange(K)[:, None]
    times = np.arange(n_frames)[:, None] / rng.uniform(4, 15, K)
    weights = np.cos(times + rng.uniform(0, 6, K))
    weights[:, 0] = 1
    S = (weights @ shapes).reshape(n_frames, 3, n_points)
    R = orbit(n_frames, 7.0) @ np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return project(R, S - S.mean(axis=2, keepdims=True)), R


@pytest.fixture(scope="module")
def M(small_scene: Scene) -> Array:
    """A factor of a real enough scene: no Gram matrix meets its constraints."""
    return factor(standardise(small_scene.tracks).W, 4)


def objective(M: Array, Q: Array, weight: float) -> float:
    """The program's objective, written out frame by frame."""
    F, _, n = M.shape
    total = unmet = 0.0
    for m1, m2 in M:
        total += m1 @ m1 + m2 @ m2
        unmet += (m1 @ Q @ m1 - m2 @ Q @ m2) ** 2 + (2 * m1 @ Q @ m2) ** 2
    return float(np.trace(Q) / (2 * F * n / total) + weight / (2 * F) * unmet)


def feasible(M: Array, rng: np.random.Generator) -> Iterator[Array]:
    """Semidefinite matrices of every rank on the program's side condition."""
    n = M.shape[2]
    for k in range(1, n + 1):
        L = rng.standard_normal((n, k))
        yield scaled(M, L @ L.T)


def scaled(M: Array, Q: Array) -> Array:
    multiple: Array = Q * (2 * len(M) / np.einsum("fri,ij,frj->", M, Q, M))
    return multiple


# The semidefinite program


@pytest.mark.parametrize("weight", [*WEIGHTS, 1e5])
def test_gram_matrix_is_optimal(M: Array, weight: float) -> None:
    """Feasible, and within the gap of a bound that no feasible matrix is below: a proof without another solver."""
    fit = fit_gram(M, weight, tol=1e-7, max_iter=20_000)
    assert fit.gap < 1e-7
    assert np.linalg.eigvalsh(fit.Q)[0] > -1e-9 * np.linalg.norm(fit.Q)
    assert np.einsum("fri,ij,frj->", M, fit.Q, M) == pytest.approx(2 * len(M), rel=1e-12)
    assert objective(M, fit.Q, weight) == pytest.approx(fit.objective, rel=1e-9)
    rng = np.random.default_rng(0)
    for Q in feasible(M, rng):
        assert objective(M, Q, weight) >= fit.bound
        near = scaled(M, fit.Q + 1e-3 * Q * np.linalg.norm(fit.Q) / np.linalg.norm(Q))
        assert objective(M, near, weight) >= fit.bound


def test_bound_holds_wherever_the_iteration_stops(M: Array) -> None:
    optimum = fit_gram(M, 1e3, tol=1e-8, max_iter=20_000).objective
    for iterations in (10, 20, 30, 50):
        early = fit_gram(M, 1e3, tol=0, max_iter=iterations)
        assert early.iterations == iterations
        assert early.bound <= optimum * (1 + 1e-12) and early.objective >= optimum * (1 - 1e-8)


@pytest.mark.parametrize("weight", [1.0, 1e3])
def test_an_independent_solver_agrees(weight: float) -> None:
    """Q = L L' with square L, by a quasi-Newton method: no minimum but the global one (Burer, Monteiro 2005)."""
    tracks, _ = non_rigid(4, n_frames=40, n_points=12, seed=3)
    M = factor(standardise(tracks).W, 2)  # rank 12 cut to 6
    n = M.shape[2]
    A, H = constraints(M), np.einsum("fri,frj->ij", M, M)
    t = 2 * len(M) * n / np.trace(H)

    def value(flat: Array) -> tuple[float, Array]:
        L = flat.reshape(n, n)
        Q, s = L @ L.T, 2 * len(M) / np.sum(H * (L @ L.T))
        r = A @ svec(Q)
        by_Q = s * np.eye(n) / t + s * s * weight / len(M) * smat(A.T @ r, n)
        size = s * np.trace(Q) / t + s * s * weight / len(M) * (r @ r)
        by_Q -= size * s / (2 * len(M)) * H
        return s * np.trace(Q) / t + s * s * weight / (2 * len(M)) * (r @ r), 2 * (by_Q @ L).ravel()

    start = np.random.default_rng(1).standard_normal(n * n)
    result = minimize(value, start, jac=True, method="BFGS", options={"gtol": 1e-9, "maxiter": 5000})
    fit = fit_gram(M, weight, tol=1e-8, max_iter=20_000)
    assert result.fun == pytest.approx(fit.objective, rel=1e-5)
    assert result.fun >= fit.bound
    Q = scaled(M, result.x.reshape(n, n) @ result.x.reshape(n, n).T)
    np.testing.assert_allclose(Q, fit.Q, atol=2e-2 * float(np.linalg.norm(Q)))


def test_gram_matrix_follows_an_orthogonal_change_of_basis(M: Array, rng: np.random.Generator) -> None:
    T = np.linalg.qr(rng.standard_normal((M.shape[2], M.shape[2])))[0]
    plain, turned = (fit_gram(X, 1e3, tol=1e-8, max_iter=20_000) for X in (M, M @ T))
    assert turned.objective == pytest.approx(plain.objective, rel=1e-7)
    np.testing.assert_allclose(turned.Q, T.T @ plain.Q @ T, atol=2e-3 * float(np.linalg.norm(plain.Q)))


def test_side_condition_and_residuals_do_not_depend_on_the_basis(M: Array, rng: np.random.Generator) -> None:
    n = M.shape[2]
    T, G = rng.standard_normal((n, n)), rng.standard_normal((n, 3))
    inverse = np.linalg.inv(T)
    np.testing.assert_allclose(residuals(M @ T, inverse @ G), residuals(M, G), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(residuals(M, 3 * G), residuals(M, G), atol=1e-12)
    Q, moved = G @ G.T, inverse @ G @ G.T @ inverse.T
    np.testing.assert_allclose(constraints(M @ T) @ svec(moved), constraints(M) @ svec(Q), rtol=1e-6, atol=1e-8)
    assert np.einsum("fri,ij,frj->", M @ T, moved, M @ T) == pytest.approx(np.einsum("fri,ij,frj->", M, Q, M))


def test_constraints_are_the_quadratic_forms(M: Array, rng: np.random.Generator) -> None:
    n = M.shape[2]
    X = rng.standard_normal((n, n))
    Q, Y = X + X.T, X @ X.T
    literal = [m1 @ Q @ m1 - m2 @ Q @ m2 for m1, m2 in M] + [2 * m1 @ Q @ m2 for m1, m2 in M]
    np.testing.assert_allclose(constraints(M) @ svec(Q), literal, atol=1e-10)
    np.testing.assert_allclose(smat(svec(Q), n), Q, atol=1e-14)
    assert svec(Q) @ svec(Y) == pytest.approx(np.sum(Q * Y))


# The refinement


def test_jacobian_against_finite_differences(M: Array, rng: np.random.Generator) -> None:
    G = rng.standard_normal((M.shape[2], 3))
    h = 1e-6
    steps = h * np.eye(G.size).reshape(-1, *G.shape)
    numeric = np.stack([(residuals(M, G + step) - residuals(M, G - step)) / (2 * h) for step in steps], axis=1)
    exact = jacobian(M, G)
    assert exact.shape == (2 * len(M), G.size)
    np.testing.assert_allclose(exact, numeric, atol=1e-6 * np.abs(numeric).max())


def test_refinement_ends_in_a_stationary_point_below_its_start(M: Array) -> None:
    w, V = np.linalg.eigh(fit_gram(M).Q)
    start = V[:, -3:] * np.sqrt(w[-3:])
    G, cost = refine(M, start, 1000)
    r = residuals(M, G)
    assert cost == pytest.approx(r @ r) and cost < np.sum(residuals(M, start) ** 2)
    slope = jacobian(M, G).T @ r
    assert np.linalg.norm(slope) < 1e-5 * np.linalg.norm(jacobian(M, G)) * np.linalg.norm(r)


# The cameras


@pytest.mark.parametrize("K", [1, 2, 3])
def test_exact_recovery(K: int) -> None:
    tracks, R = non_rigid(K)
    assert errors.e_r(estimate_cameras(tracks, K), R) < 1e-7


def test_structure_and_cameras_from_tracks_alone() -> None:
    tracks, _ = non_rigid(3)
    R = estimate_cameras(tracks, 3)
    S = BMM(tol=1e-7).reconstruct(Observations(tracks, R)).structure
    assert S is not None
    np.testing.assert_allclose(project(R, S), tracks, atol=1e-9)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(2), (80, 1, 1)), atol=1e-12)


def test_the_residual_is_flat() -> None:
    """Six shapes, exact tracks: a vanishing residual comes with cameras that are degrees off."""
    tracks, R = non_rigid(6)
    M = factor(standardise(tracks).W, 6)
    G, cost = metric_upgrade(M)
    assert cost < 1e-9 and errors.e_r(orthonormal_rows(M @ G), R) > 5e-3


def test_a_larger_rank_than_the_tracks_have_changes_nothing() -> None:
    tracks, R = non_rigid(2)
    assert factor(standardise(tracks).W, 11).shape[2] == 6
    assert errors.e_r(estimate_cameras(tracks, 11), R) < 1e-7


def test_columns_stay_fewer_than_the_constraints_determine(rng: np.random.Generator) -> None:
    assert factor(rng.standard_normal((10, 2, 30)), 11).shape[2] == 6
    assert factor(rng.standard_normal((3, 2, 30)), 11).shape[2] == 3


def test_same_cameras_for_the_same_scene(small_scene: Scene, rng: np.random.Generator) -> None:
    """Units, order and any orthogonal mixing of the tracks that keeps their centroid leave the cameras alone."""
    tracks = small_scene.tracks
    plain = estimate_cameras(tracks, 4)
    order = rng.permutation(tracks.shape[2])
    for other in (250 * tracks, tracks + 7.0, tracks[:, :, order]):
        assert errors.e_r(estimate_cameras(other, 4), plain) < 1e-5


def test_signs_are_continuous() -> None:
    tracks, R = non_rigid(3)
    result = estimate_cameras(tracks, 3)
    assert (np.einsum("fij,fij->f", result[1:], result[:-1]) > 0).all()
    flips = np.where(np.arange(len(R)) % 5 < 2, -1.0, 1.0)[:, None, None]
    np.testing.assert_allclose(orthonormal_rows(3 * R * flips), R * flips[0], atol=1e-12)


@pytest.mark.parametrize("level", [0.0, 0.02, 0.05])
def test_noise_does_not_hide_the_lowest_residual(small_scene: Scene, level: float) -> None:
    """From the tracks alone the refinement ends as low as from the true cameras."""
    tracks = small_scene.with_noise(level).tracks
    M = factor(standardise(tracks).W, 3)
    truth = np.linalg.lstsq(M.reshape(-1, M.shape[2]), present(small_scene.cameras).reshape(-1, 3), rcond=None)[0]
    assert metric_upgrade(M)[1] <= refine(M, truth.astype(np.float64))[1] * (1 + 1e-6)


@pytest.mark.parametrize("rank", [0, -1, 2.5, True, None])
def test_ranks_that_are_none(small_scene: Scene, rank: object) -> None:
    with pytest.raises(MethodError, match=r"cameras\.rank"):
        estimate_cameras(small_scene.tracks, rank)  # type: ignore[arg-type]


@pytest.mark.parametrize(("setting", "value"), [("start", "random"), ("start", None), ("refine", 1), ("refine", "no")])
def test_settings_that_are_none(small_scene: Scene, setting: str, value: object) -> None:
    with pytest.raises(MethodError, match=rf"cameras\.{setting}"):
        estimate_cameras(small_scene.tracks, 3, **{setting: value})  # type: ignore[arg-type]


def test_a_rigid_start_is_enough_for_a_rigid_scene_alone() -> None:
    """With one shape the first three columns are all there is, up to the finite weight; three shapes need the whole."""
    tracks, R = non_rigid(1)
    assert errors.e_r(estimate_cameras(tracks, 1, start="rigid", refine=False), R) < 1e-3
    tracks, R = non_rigid(3)
    by_size = {
        (start, refine): errors.e_r(estimate_cameras(tracks, 3, start=start, refine=refine), R)
        for start in STARTS
        for refine in (False, True)
    }
    assert by_size["trace_norm", True] < 1e-7
    assert by_size["trace_norm", False] < by_size["rigid", False]


@pytest.mark.parametrize("start", STARTS)
def test_what_is_left_is_what_the_factor_leaves(M: Array, start: str) -> None:
    for refined in (False, True):
        G, left = metric_upgrade(M, start, refined)
        assert left == pytest.approx(np.sum(residuals(M, G) ** 2), rel=1e-9)
    assert metric_upgrade(M, start)[1] <= metric_upgrade(M, start, refined=False)[1]


def test_a_frame_without_extent_is_named(small_scene: Scene) -> None:
    tracks = small_scene.tracks.copy()
    tracks[4, 1] = 0.5
    with pytest.raises(MethodError, match="frame 4"):
        estimate_cameras(tracks, 3)


# The published numbers


def measure(
    scene: Scene, rank: int, cameras: Array | None = None, rotation_rank: int | None = None
) -> dict[str, float]:
    R = estimate_cameras(scene.tracks, rotation_rank or rank) if cameras is None else cameras
    result = BMM(rank=rank).reconstruct(Observations(scene.tracks, R))
    return metrics.evaluate(scene, result, known_cameras=cameras is not None)


def share(measured: dict[str, float], name: str, metric: str, logged: str = "") -> float:
    """Measured over published."""
    printed = published.printed("single_body", name, "bmm", metric)
    assert printed is not None
    return measured[logged or metric] / float(printed)


@pytest.mark.data
@pytest.mark.parametrize("name", RANKS)
def test_published_errors_with_the_published_rank(data_folder: Path, name: str) -> None:
    """Within 4 %; yoga alone stays above, by 11 and 20 %."""
    measured = measure(load_single(data_folder, name), RANKS[name])
    tolerance = 0.04 if name != "yoga" else 0.21
    e_3d = "e_3d_dai" if name in AKHTER else "e_3d_dai_cam"
    assert share(measured, name, e_3d) == pytest.approx(1, abs=tolerance)
    if name in AKHTER:
        assert share(measured, name, "e_r") == pytest.approx(1, abs=min(tolerance, 0.115))


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("name", RANKS)
def test_with_13_shapes_in_the_rotation_none_is_missed(data_folder: Path, name: str) -> None:
    measured = measure(load_single(data_folder, name), RANKS[name], rotation_rank=13)
    assert share(measured, name, "e_3d_dai" if name in AKHTER else "e_3d_dai_cam") < 1.1
    if name in AKHTER:
        assert share(measured, name, "e_r") < 1.1


@pytest.mark.data
@pytest.mark.parametrize("name", ["yoga", "pickup", "stretch"])
def test_published_errors_with_known_cameras(data_folder: Path, name: str) -> None:
    scene = load_single(data_folder, name)
    measured = measure(scene, RANKS[name], cameras=scene.cameras)
    assert share(measured, name, "e_3d_gt_rotation", "e_3d_dai") == pytest.approx(1, abs=0.02)


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("pair", [("drink", "walking"), ("stretch", "yoga"), ("face", "pickup")])
def test_pairs_with_noise_end_as_low_as_from_the_true_cameras(data_folder: Path, pair: tuple[str, str]) -> None:
    scene = load_scene(data_folder, pair)
    for level in (0.0, 0.05):
        tracks = scene.with_noise(level).tracks
        M = factor(standardise(tracks).W, 11)
        truth = np.linalg.lstsq(M.reshape(-1, M.shape[2]), present(scene.cameras).reshape(-1, 3), rcond=None)[0]
        assert metric_upgrade(M)[1] <= refine(M, truth.astype(np.float64))[1] * (1 + 1e-3)
