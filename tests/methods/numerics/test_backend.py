"""The dense solver on arrays of other libraries: the same code, the same numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import array_api_strict
import numpy as np
import pytest

from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import MethodError, standardise
from nrsfm.methods.multibody.lagrangian import Problem, State
from nrsfm.methods.multibody.printed import MultiBody
from nrsfm.methods.numerics.backend import cholesky_solve, gram, largest, on_device, shifted_cholesky, to_numpy


@pytest.fixture(params=["standard", "torch"])
def convert(request: pytest.FixtureRequest) -> Any:
    """numpy's arrays as those of the standard's strict reference, which has nothing else, or as PyTorch's."""
    if request.param == "standard":
        return array_api_strict.asarray
    pytest.importorskip("torch")
    return lambda x: on_device(x, "cpu")


@pytest.mark.parametrize("diagonal", ["threshold", "exact", "paper"])
def test_the_iterates_are_those_of_numpy(small_scene: Scene, convert: Any, diagonal: str) -> None:
    W = standardise(small_scene.tracks).W
    ours = Problem(W, small_scene.cameras, 3e-3, 0.1, diagonal)
    theirs = Problem(convert(W), convert(small_scene.cameras), 3e-3, 0.1, diagonal)
    one, two = ours.start(1e-3), theirs.start(1e-3)
    for _ in range(60):
        (one, gaps), (two, others) = ours.iterate(one), theirs.iterate(two)
        one, two = replace(one, b=1.1 * one.b), replace(two, b=1.1 * two.b)
    assert type(two.S) is type(convert(W))
    for name in ("S", "shape", "C", "E", "Y1", "Y2", "Y3", "Y4"):
        np.testing.assert_allclose(to_numpy(getattr(two, name)), getattr(one, name), atol=1e-7)
    for name, gap in gaps.items():
        assert largest(others[name]) == pytest.approx(largest(gap), abs=1e-7)
    assert theirs.objective(two) == pytest.approx(ours.objective(one), rel=1e-8)
    assert theirs.lagrangian(two) == pytest.approx(ours.lagrangian(one), rel=1e-8)


def test_more_rows_than_tracks(small_scene: Scene, convert: Any, rng: np.random.Generator) -> None:
    """The other side of the code step."""
    F, P = 3, 12
    triple = lambda: rng.standard_normal((F, 3, P))  # noqa: E731
    square = lambda: rng.standard_normal((P, P))  # noqa: E731
    state = State(triple(), triple(), square(), square(), triple(), triple(), square(), rng.standard_normal(P), 0.7)
    W, cameras = small_scene.tracks[:F, :, :P], small_scene.cameras[:F]
    moved = {name: convert(getattr(state, name)) for name in ("S", "shape", "C", "E", "Y1", "Y2", "Y3", "Y4")}
    found = Problem(convert(W), convert(cameras), 3e-3, 0.1).code_step(replace(state, **moved))
    np.testing.assert_allclose(to_numpy(found), Problem(W, cameras, 3e-3, 0.1).code_step(state), atol=1e-10)


def test_factors_solve(convert: Any, rng: np.random.Generator) -> None:
    A, B = rng.standard_normal((20, 9)), rng.standard_normal((9, 4))
    X = cholesky_solve(shifted_cholesky(gram(convert(A)), 0.5), convert(B))
    np.testing.assert_allclose((A.T @ A + 0.5 * np.eye(9)) @ to_numpy(X), B, atol=1e-10)


def test_a_whole_solve_on_a_device(small_scene: Scene) -> None:
    pytest.importorskip("torch")
    arguments = (small_scene.tracks, small_scene.cameras, 2)
    plain = MultiBody(form="dense", max_iter=60).reconstruct(*arguments)
    moved = MultiBody(form="dense", max_iter=60, device="cpu").reconstruct(*arguments)
    np.testing.assert_allclose(moved.structure, plain.structure, atol=1e-8)
    np.testing.assert_array_equal(moved.labels, plain.labels)
    assert isinstance(moved.affinity, np.ndarray)


def test_a_device_that_is_not_there_is_named(small_scene: Scene) -> None:
    """Whether PyTorch is not installed, or has no such device."""
    with pytest.raises(MethodError, match=r"method\.device is 'moon'"):
        MultiBody(form="dense", device="moon").reconstruct(small_scene.tracks, small_scene.cameras, 2)
    with pytest.raises(MethodError, match=r"method\.form=dense"):
        MultiBody(device="cpu").reconstruct(small_scene.tracks, small_scene.cameras, 2)
