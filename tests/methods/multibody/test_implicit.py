"""Sparse plus low rank in place of dense: the same iterates, to rounding, over a full solve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nrsfm.datasets.generated import procedural
from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import standardise
from nrsfm.methods.multibody import implicit
from nrsfm.methods.multibody.implicit import ImplicitProblem, _leading
from nrsfm.methods.multibody.lagrangian import PrintedProblem
from nrsfm.methods.multibody.problem import Gaps, State, iterate
from nrsfm.methods.multibody.spatial import Neighbours, SpatialProblem
from tests.methods.parts import present


@pytest.fixture(scope="module")
def scene() -> Scene:
    return procedural.load_scene(["face", "heart"], 25, 8, 0, name="surfaces", placement=[3, 0, 0])


def pair(scene: Scene, spatial: float, dtype: type = np.float64) -> tuple[PrintedProblem, ImplicitProblem]:
    """The dense and the implicit problem of one scene."""
    W = standardise(scene.tracks).W
    arguments = (W, present(scene.cameras), 3e-3, 0.1)
    if not spatial:
        return PrintedProblem(*arguments), ImplicitProblem(*arguments, dtype=dtype)
    neighbours = Neighbours(scene.edges, scene.n_points, spatial)
    return (
        SpatialProblem(*arguments, neighbours=neighbours),
        ImplicitProblem(*arguments, neighbours=neighbours, dtype=dtype),
    )


def solve(problem: PrintedProblem, iterations: int, b: float = 1e-3) -> tuple[State, Gaps]:
    state = problem.start(b)
    gaps: Gaps = {}
    for _ in range(iterations):
        state, gaps = iterate(problem, state)
        state = replace(state, b=min(10.0, 1.2 * state.b))  # the penalty reaches its cap before the end
    return state, gaps


@pytest.mark.parametrize("spatial", [0.0, 0.5], ids=["C", "CD"])
def test_a_full_solve_is_the_dense_one_to_rounding(scene: Scene, spatial: float) -> None:
    dense, problem = pair(scene, spatial)
    (wanted, gaps), (result, others) = solve(dense, 70), solve(problem, 70)
    assert 0 < result.E.nnz < 0.7 * wanted.E.size
    np.testing.assert_allclose(result.S, wanted.S, atol=1e-10)
    np.testing.assert_allclose(result.E.toarray(), wanted.E, atol=1e-9)
    for name, gap in gaps.items():
        assert np.abs(others[name]).max() == pytest.approx(np.abs(gap).max(), abs=1e-9)
    assert problem.objective(result) == pytest.approx(dense.objective(wanted), rel=1e-10)


@pytest.mark.parametrize("spatial", [0.0, 0.5], ids=["C", "CD"])
def test_blocks_and_threads_change_nothing(scene: Scene, spatial: float, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = pair(scene, spatial)[1]
    whole = solve(problem, 25)[0]
    monkeypatch.setattr(implicit, "BLOCK_BYTES", 7 * 8 * scene.n_points)
    monkeypatch.setattr(implicit, "blas_threads", lambda: 2)
    split = solve(problem, 25)[0]
    assert abs(whole.E - split.E).max() < 1e-9
    np.testing.assert_allclose(split.S, whole.S, atol=1e-10)


def test_single_precision_is_near(scene: Scene) -> None:
    double, single = pair(scene, 0.0)[1], replace(pair(scene, 0.0, np.float32)[1], cg_tol=1e-5)
    wanted, result = solve(double, 70)[0], solve(single, 70)[0]
    assert result.E.dtype == np.float32 and len(result.C.V) < len(wanted.C.V)
    assert np.linalg.norm(result.S - wanted.S) < 2e-3 * np.linalg.norm(wanted.S)


def test_leading_directions_leave_out_no_more_than_they_may(rng: np.random.Generator) -> None:
    rows = rng.standard_normal((12, 5)) @ rng.standard_normal((5, 80)) + 1e-4 * rng.standard_normal((12, 80))
    Q, k = _leading(rows, 1e-3)
    assert Q.shape == (12, 5)
    np.testing.assert_allclose(Q.T @ Q, np.eye(5), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(Q.T @ rows, axis=1) ** 2, k)
    assert np.linalg.norm(rows - Q @ (Q.T @ rows)) <= 1e-3 * np.linalg.norm(rows)
    assert _leading(rows[:, :3], 0.0)[0].shape == (12, 12)
