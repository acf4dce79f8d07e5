"""The block matrix method's shape step: constraint, optimality, and the published scene."""

from __future__ import annotations

import numpy as np
import pytest

from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import Array, MethodError, Observations, standardise
from nrsfm.methods.structure.bmm import BMM, cut_rank, fit_shape
from tests.methods.parts import assert_least_over_depth, assert_subgradient, observed, present


@pytest.fixture(scope="module")
def low_rank() -> tuple[np.ndarray, np.ndarray]:
    """A structure of rank 2 in F x 3P under an orbiting camera: exactly recoverable."""
    rng = np.random.default_rng(1)
    F, P = 60, 30
    S = (np.stack([np.ones(F), np.cos(np.arange(F) / 9)], 1) @ rng.standard_normal((2, 3 * P))).reshape(F, 3, P)
    S -= S.mean(axis=2, keepdims=True)
    return S, orbit(F, 7.0)


def test_equality_reproduces_the_tracks(small_scene: Scene) -> None:
    structure = present(BMM(tol=1e-7).reconstruct(observed(small_scene)).structure)
    np.testing.assert_allclose(project(present(small_scene.cameras), structure), small_scene.tracks, atol=1e-9)


def test_recovers_a_low_rank_structure(low_rank: tuple[np.ndarray, np.ndarray]) -> None:
    S, R = low_rank
    structure = present(BMM(tol=1e-8).reconstruct(Observations(project(R, S), R)).structure)
    assert np.linalg.norm(structure - S) < 1e-4 * np.linalg.norm(S)


def test_no_feasible_structure_has_a_smaller_nuclear_norm(small_scene: Scene) -> None:
    """Depth is the only freedom of R S = W; no change of it lowers the norm."""
    W, R = standardise(small_scene.tracks).W, present(small_scene.cameras)
    fit = fit_shape(W, R, tol=1e-9)

    def norm(S: Array) -> float:
        return float(np.linalg.norm(S.reshape(len(S), -1), "nuc"))

    assert_least_over_depth(norm, fit.structure, R)


def test_weighted_problem_is_stationary(small_scene: Scene) -> None:
    """At the minimum of l2 |S|_* + 1/2 |W - R S|^2, -R'(R S - W) is l2 times a subgradient of the nuclear norm."""
    W, R, l2 = standardise(small_scene.tracks).W, present(small_scene.cameras), 0.5
    S = fit_shape(W, R, l2, tol=1e-10, max_iter=20000).structure
    G = (R.transpose(0, 2, 1) @ (W - R @ S)).reshape(len(S), -1) / l2
    assert_subgradient(G, S.reshape(len(S), -1), 2e-3)


def test_smaller_weight_approaches_equality(small_scene: Scene) -> None:
    W, R = standardise(small_scene.tracks).W, present(small_scene.cameras)
    exact = fit_shape(W, R, tol=1e-8).structure
    gaps = [np.linalg.norm(fit_shape(W, R, l2, tol=1e-8).structure - exact) for l2 in (0.1, 0.01, 0.001)]
    assert gaps[0] > gaps[1] > gaps[2]


def test_rank_cut(small_scene: Scene) -> None:
    S = present(small_scene.structure)
    cut = cut_rank(S, 3)
    assert np.linalg.matrix_rank(cut.reshape(len(S), -1)) == 3
    np.testing.assert_allclose(cut_rank(S, 30), S, atol=1e-12)
    with pytest.raises(MethodError, match="rank"):
        cut_rank(S, 0)


def test_negative_weight_is_refused(small_scene: Scene) -> None:
    with pytest.raises(MethodError, match="l2"):
        BMM(l2=-1).reconstruct(observed(small_scene))
