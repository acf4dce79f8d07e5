"""Observations refuse what no method can work with; hyper-parameters are checked in one line."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from nrsfm.datasets.cameras import orbit
from nrsfm.methods.base import (
    Array,
    MethodError,
    Observations,
    check_at_least,
    check_count,
    check_gap_handling,
    check_positive,
    check_word,
)
from nrsfm.methods.structure.bmm import BMM


@pytest.fixture
def tracks(rng: np.random.Generator) -> Array:
    return rng.standard_normal((6, 2, 5))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tracks": np.full((6, 2, 5), np.nan)}, "NaN"),
        ({"tracks": np.zeros((6, 3, 5))}, r"shape \(6, 3, 5\)"),
        ({"tracks": np.zeros((6, 2))}, r"shape \(6, 2\)"),
        ({"tracks": np.zeros((6, 2, 0))}, r"shape \(6, 2, 0\)"),
        ({"cameras": orbit(5)}, r"cameras have shape \(5, 2, 3\)"),
        ({"cameras": 2 * orbit(6)}, "not orthonormal"),
        ({"visible": np.ones((4, 3), dtype=bool)}, r"visible \(4, 3\)"),
        ({"visible": np.eye(6, 5, dtype=bool)}, "frame 0 is observed less than twice"),
    ],
)
def test_wrong_observations_are_refused(tracks: Array, changes: dict[str, Any], message: str) -> None:
    right = Observations(tracks, orbit(6))
    with pytest.raises(MethodError, match=message):
        replace(right, **changes)


def test_absent_cameras_are_named(tracks: Array) -> None:
    assert (Observations(tracks, orbit(6)).required_cameras() == orbit(6)).all()
    with pytest.raises(MethodError, match="needs cameras"):
        Observations(tracks).required_cameras()


def test_gaps_are_for_methods_that_declare_to_handle_them(tracks: Array) -> None:
    class Careless(BMM):
        handles_gaps = False

    visible = np.ones((6, 5), dtype=bool)
    check_gap_handling(BMM(), visible)
    check_gap_handling(Careless(), None)
    with pytest.raises(MethodError, match="Careless cannot work with gaps"):
        check_gap_handling(Careless(), visible)


@pytest.mark.parametrize("value", [0, -1.0, float("nan"), float("inf"), True, "1", None])
def test_settings_that_are_not_positive(value: object) -> None:
    with pytest.raises(MethodError, match=r"SimpleNamespace: weight is .*, wanted a number > 0"):
        check_positive(SimpleNamespace(weight=value), "weight")


def test_other_settings() -> None:
    owner = SimpleNamespace(least=0, count=3, word="a")
    check_at_least(owner, 0, "least", "count")
    check_count(owner, "count")
    check_word(owner, "word", ("a", "b"))
    with pytest.raises(MethodError, match="least is 0, wanted a number >= 1"):
        check_at_least(owner, 1, "least")
    for wrong in (0, 1.5, True):
        with pytest.raises(MethodError, match="wanted a whole number >= 1"):
            check_count(SimpleNamespace(count=wrong), "count")
    with pytest.raises(MethodError, match="word is 'a', wanted one of b, c"):
        check_word(owner, "word", ("b", "c"))
