"""The moving picture has a picture for each chosen frame, and the points move in it."""

from __future__ import annotations

import itertools
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image, ImageSequence

from nrsfm.reports.figures import animation
from nrsfm.reports.figures.animation import animate, still


def test_every_chosen_frame_is_a_picture(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    structure = rng.standard_normal((6, 3, 9))
    tracks = structure[:, :2].copy()
    tracks[2, :, 4] = np.nan  # not observed
    path = tmp_path / "new" / "picture.gif"
    animate(path, tracks, structure, np.repeat([0, 1, 2], 3), np.array([[0, 1], [4, 5]]), dpi=40)
    with Image.open(path) as picture:
        pictures = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.all_frames(picture)]
    assert [picture.shape for picture in pictures] == 6 * [(160, 320, 3)]
    assert all((a != b).any() for a, b in itertools.pairwise(pictures))


def test_long_sequences_are_thinned(tmp_path: Path) -> None:
    structure = np.random.default_rng(1).standard_normal((200, 3, 3))
    animate(tmp_path / "a.gif", structure[:, :2], structure, dpi=20)
    with Image.open(tmp_path / "a.gif") as picture:
        assert len(ImageSequence.all_frames(picture)) == animation.FRAMES


def test_a_still_shows_the_middle_frame_alone() -> None:
    structure = np.random.default_rng(2).standard_normal((7, 3, 5))
    tracks = structure[:, :2].copy()
    picture = still(tracks, structure, dpi=20)
    with Image.open(BytesIO(picture)) as image:
        assert image.format == "PNG"
        assert image.size == (160, 80)
    other = structure.copy()
    other[[0, 6]] += 5  # frames that are not shown
    assert still(tracks, other, dpi=20) == picture
    other[3, :, 0] += 1
    assert still(tracks, other, dpi=20) != picture
