"""What several tests of methods are made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import Array, Observations
from nrsfm.methods.multibody.problem import MULTIPLIERS, Problem, State

T = TypeVar("T")


def present(value: T | None) -> T:
    """The value, which is not None."""
    assert value is not None
    return value


def observed(scene: Scene) -> Observations:
    """The tracks, cameras and gaps of a scene."""
    return Observations(scene.tracks, scene.cameras, scene.visible)


def random_state(rng: np.random.Generator, n_frames: int, n_points: int, width: int | None = None) -> State:
    """A random state with a medium penalty; E and Y3 have ``width`` columns, by default as many as C."""

    def triple() -> Array:
        return rng.standard_normal((n_frames, 3, n_points))

    def square(columns: int) -> Array:
        return 0.3 * rng.standard_normal((n_points, columns))

    wide = width or n_points
    return State(
        S=triple(),
        shape=triple(),
        C=square(n_points),
        E=square(wide),
        Y1=triple(),
        Y2=triple(),
        Y3=square(wide),
        Y4=rng.standard_normal((n_points,)),
        b=0.7,
    )


def lagrangian(problem: Problem, state: State) -> float:
    """The augmented Lagrangian whose blocks the steps minimise."""
    norm = np.linalg.norm(state.shape.reshape(len(state.shape), -1), "nuc")
    value = problem.objective(replace(state, nuclear_norm=float(norm)))
    for name, gap in problem.gaps(state).items():
        value += float(np.sum(getattr(state, MULTIPLIERS[name]) * gap))
        value += problem.penalty(state, name) / 2 * float(np.sum(gap**2))
    return value


def assert_least_over_depth(norm: Callable[[Array], float], S: Array, cameras: Array) -> None:
    """No change of depth, which is the only freedom of R S = W, lowers a norm of the structure."""
    depth = np.cross(cameras[:, 0], cameras[:, 1])[:, :, None]
    lowest = norm(S)
    rng = np.random.default_rng(0)
    for _ in range(40):
        change = depth * rng.standard_normal((len(S), 1, S.shape[2])) * 10.0 ** rng.uniform(-4, 0)
        assert norm(S + change) >= lowest - 1e-5 * lowest


def assert_subgradient(G: Array, X: Array, tol: float) -> None:
    """G is a subgradient of the nuclear norm at X: |G|_2 <= 1, and U'G V = I in the singular vectors of X."""
    U, s, Vt = np.linalg.svd(X, full_matrices=False)
    r = int((s > 1e-5 * s[0]).sum())
    assert np.linalg.norm(G, 2) < 1 + 1e-3
    np.testing.assert_allclose(U[:, :r].T @ G @ Vt[:r].T, np.eye(r), atol=tol)
