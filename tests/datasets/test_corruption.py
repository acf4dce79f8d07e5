"""Corrupted tracks: how much, where, and what a draw depends on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from nrsfm.datasets.corruption import ZOOMS, corrupt
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.scene import Scene

F, P = 60, 25
W = np.random.default_rng(0).standard_normal((F, 2, P))


@pytest.mark.parametrize("share", [0.01, 0.05, 0.1])
def test_outliers_are_as_many_as_asked_and_in_the_image(share: float) -> None:
    changed = corrupt(W, "s", outliers=share)
    bad = (changed != W).any(axis=1)
    assert bad.sum() == round(share * F * P)
    for axis in range(2):
        assert W[:, axis].min() <= changed[:, axis].min() and changed[:, axis].max() <= W[:, axis].max()


def test_a_track_that_jumps_follows_another_to_the_end() -> None:
    changed = corrupt(W, "s", jumps=0.2)
    jumped = np.flatnonzero((changed != W).any(axis=(0, 1)))
    assert len(jumped) == round(0.2 * P)
    for p in jumped:
        start = int(np.argmax((changed[:, :, p] != W[:, :, p]).any(axis=1)))
        assert F // 2 <= start < 3 * F // 4
        assert any((changed[start:, :, p] == W[start:, :, q]).all() for q in range(P) if q != p)


@pytest.mark.parametrize("zooming", ZOOMS)
def test_zoom_scales_frames_about_the_origin(zooming: str) -> None:
    factors = corrupt(W, "s", zoom=0.3, zooming=zooming) / W
    assert np.ptp(factors, axis=(1, 2)).max() < 1e-12
    assert np.log(factors[:, 0, 0]).mean() == pytest.approx(0, abs=1e-12)
    assert 0.65 < factors.min() < 0.8 and 1.2 < factors.max() < 1.45


def test_a_draw_follows_scene_amount_and_repeat() -> None:
    for amount in ({"outliers": 0.1}, {"jumps": 0.2}, {"zoom": 0.3, "zooming": "random"}):
        settings: dict[str, Any] = dict(amount)
        first = corrupt(W, "s", **settings)
        np.testing.assert_array_equal(corrupt(W, "s", **settings), first)
        assert (corrupt(W, "t", **settings) != first).any()
        assert (corrupt(W, "s", repeat=1, **settings) != first).any()


def test_gaps_stay_and_nothing_asked_changes_nothing() -> None:
    gappy = np.where(np.random.default_rng(1).random((F, 1, P)) < 0.1, np.nan, W)
    changed = corrupt(gappy, "s", outliers=0.1, jumps=0.1, zoom=0.2)
    np.testing.assert_array_equal(np.isnan(gappy), np.isnan(changed))
    np.testing.assert_array_equal(corrupt(gappy, "s"), gappy)


def test_the_truth_stays_as_it_is(small_scene: Scene) -> None:
    changed = small_scene.with_corruption(outliers=0.1)
    assert changed.structure is small_scene.structure and changed.labels is small_scene.labels
    assert (changed.tracks != small_scene.tracks).any()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"outliers": 1.0}, "corruption.outliers is 1.0, wanted a number from 0 to less than 1"),
        ({"jumps": -0.1}, "corruption.jumps is -0.1"),
        ({"zoom": True}, "corruption.zoom is True"),
        ({"zooming": "fast"}, "corruption.zooming is 'fast', wanted one of smooth, random"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        corrupt(W, "s", **settings)
