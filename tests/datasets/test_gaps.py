"""Observations that are dropped: how many, which, and what a draw depends on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.gaps import drop
from nrsfm.datasets.scene import Scene

F, P = 60, 25
W = np.random.default_rng(0).standard_normal((F, 2, P))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.2, 0.3, 0.7])
@pytest.mark.parametrize(("kind", "length"), [("random", 1), ("stretches", 20), ("stretches", 7), ("stretches", 99)])
def test_share_is_exact(kind: str, length: int, share: float) -> None:
    visible = drop(W, kind, share, length, 0, "s")
    assert (~visible).sum() == round(share * F * P)
    assert visible.sum(axis=0).min() >= 2 and visible.sum(axis=1).min() >= 2


def test_a_draw_follows_scene_kind_share_and_repeat() -> None:
    first = drop(W, "random", 0.2, 1, 0, "s")
    np.testing.assert_array_equal(drop(2 * W + 1, "random", 0.2, 1, 0, "s"), first)
    for change in (("random", 0.2, 1, 1, "s"), ("random", 0.2, 1, 0, "t"), ("random", 0.21, 1, 0, "s")):
        assert (drop(W, *change) != first).mean() > 0.1


def test_stretches_are_of_the_length_that_is_asked() -> None:
    """Runs of hidden frames start and end where a stretch does, or at a neighbour that is hidden as well."""
    visible = drop(W, "stretches", 0.3, 10, 0, "s")
    single = drop(W, "random", 0.3, 1, 0, "s")
    inner: list[int] = []
    alone: list[int] = []
    for hidden, runs in ((~visible, inner), (~single, alone)):
        for track in hidden.T:
            edges = np.flatnonzero(np.diff(np.r_[0, track.astype(int), 0]))
            starts, ends = edges[::2], edges[1::2]
            runs += [e - s for s, e in zip(starts, ends, strict=True) if s > 0 and e < F]
    assert np.mean([run % 10 == 0 for run in inner]) > 0.9 and np.mean(alone) < 2


@pytest.mark.parametrize("kind", ["random", "stretches"])
def test_gaps_that_are_there_already_stay(kind: str) -> None:
    before = np.random.default_rng(1).random((F, P)) > 0.1
    scene = Scene("s", np.where(before[:, None], W, np.nan), visible=before)
    after = scene.with_gaps(kind, 0.25, 5)
    assert after.visible is not None and not (after.visible & ~before).any()
    assert after.visible.sum() == before.sum() - round(0.25 * before.sum())
    assert np.isnan(after.tracks.transpose(0, 2, 1)[~after.visible]).all()


def test_nothing_dropped() -> None:
    scene = Scene("s", W)
    assert scene.with_gaps("none", 0.5) is scene and scene.with_gaps("random", 0.0) is scene
    dropped = scene.with_gaps("random", 0.5)
    assert dropped.structure is scene.structure and dropped.visible is not None


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (("some", 0.1, 1), "gaps.kind is 'some'"),
        (("random", 1.0, 1), "gaps.share is 1.0"),
        (("random", -0.1, 1), "gaps.share"),
        (("random", float("nan"), 1), "gaps.share"),
        (("random", "all", 1), "gaps.share"),
        (("stretches", 0.1, 0), "gaps.length is 0"),
        (("stretches", 0.1, 2.5), "gaps.length"),
        (("random", 0.99, 1), "more than can be dropped"),
    ],
)
def test_settings_out_of_range(settings: tuple[Any, Any, Any], message: str) -> None:
    kind, share, length = settings
    with pytest.raises(DatasetError, match=message):
        drop(W, kind, share, length, 0, "s")
