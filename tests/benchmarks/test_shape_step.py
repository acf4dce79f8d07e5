"""The shape step on pickup against two alternatives that solve the same problem to the same objective.

min  l2 |S#|_* + 1/2 |W - R S|^2,  l2 = 1, W = R S_gt, cameras known
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.methods.numerics.proximal import singular_value_threshold
from nrsfm.methods.structure.bmm import fit_shape
from tests.benchmarks.timing import timed

pyproximal = pytest.importorskip("pyproximal", reason="installed by 'make bench' alone")
L2 = 1.0
OPTIMUM = 326.774  # of fit_shape at tol 1e-9 and of the continuation, which agree to six digits

pytestmark = pytest.mark.skipif(not os.environ.get("NRSFM_DATA"), reason="NRSFM_DATA is not set")


Pickup = tuple[np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def pickup() -> Pickup:
    """Tracks (F, 2, P), cameras (F, 2, 3) and structure (F, 3, P) of pickup."""
    arrays = read_mat(Path(os.environ["NRSFM_DATA"]) / "mocap/pickup.mat", ["S", "Rs"])
    S, R = arrays["S"].reshape(357, 3, 41), arrays["Rs"].reshape(357, 2, 3)
    return R @ S, R, S


def objective(W: np.ndarray, R: np.ndarray, S: np.ndarray) -> float:
    return float(L2 * np.linalg.norm(S.reshape(len(S), -1), "nuc") + 0.5 * np.sum((W - R @ S) ** 2))


def continuation(W: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Fixed-point continuation as the block matrix method prints it: mu from 4 by 1/4, step 0.2, inner stop 1e-6."""
    F, _, P = W.shape
    S, mu, step = np.zeros((F, 3, P)), 4.0, 0.2
    while True:
        for _ in range(5000):
            moved = S - step * (R.transpose(0, 2, 1) @ (R @ S - W))
            shrunk, _ = singular_value_threshold(moved.reshape(F, 3 * P), step * mu)
            change = np.linalg.norm(shrunk - S.reshape(F, 3 * P)) / max(1.0, float(np.linalg.norm(S)))
            S = shrunk.reshape(F, 3, P)
            if change < 1e-6:
                break
        if mu <= L2:
            return S
        mu = max(L2, mu / 4)


def by_pyproximal(W: np.ndarray, R: np.ndarray) -> np.ndarray:
    """pyproximal's ADMM, 200 iterations at tau 0.9, frame by frame in the data term as in its tutorial."""
    F, _, P = W.shape

    class Data(pyproximal.ProxOperator):  # type: ignore[misc, name-defined]
        def __init__(self) -> None:
            super().__init__(None, False)

        def __call__(self, x: np.ndarray) -> float:
            return float(0.5 * np.sum((R @ x.reshape(F, 3, P) - W) ** 2))

        def prox(self, x: np.ndarray, tau: float) -> np.ndarray:
            X = x.reshape(F, 3, P)
            frames = [np.linalg.solve(np.eye(3) + tau * R[f].T @ R[f], X[f] + tau * R[f].T @ W[f]) for f in range(F)]
            return np.stack(frames).ravel()

    nuclear = pyproximal.Nuclear((F, 3 * P), L2)
    solved = pyproximal.optimization.primal.ADMM(Data(), nuclear, x0=np.zeros(3 * F * P), tau=0.9, niter=200)[0]
    S: np.ndarray = solved.reshape(F, 3, P)
    return S


SOLVERS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "adaptive": lambda W, R: fit_shape(W, R, L2, tol=1e-5).structure,
    "continuation": continuation,
    "pyproximal": by_pyproximal,
}


@pytest.mark.benchmark(group="shape step on pickup, to the same objective")
@pytest.mark.parametrize("solver", SOLVERS)
def test_shape_step(
    benchmark: BenchmarkFixture, pickup: tuple[np.ndarray, np.ndarray, np.ndarray], solver: str
) -> None:
    W, R, truth = pickup
    S = timed(benchmark, 3, 1, SOLVERS[solver], W, R)
    benchmark.extra_info["objective"] = objective(W, R, S)
    benchmark.extra_info["distance to truth"] = float(np.linalg.norm(S - truth) / np.linalg.norm(truth))
    assert objective(W, R, S) == pytest.approx(OPTIMUM, rel=3e-4)
