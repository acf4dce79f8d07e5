"""Text tables as programs write them: each gives the same tracks, and what is not clear is refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.csvfile import read_csv
from nrsfm.datasets.readers.trackfile import Asked, TrackFile

F, P = 7, 6
NODES, ANIMALS = ("nose", "tail_base", "left ear"), ("ann", "bob")


@pytest.fixture
def tracks() -> np.ndarray:
    """(F, 2, P), NaN where a track is not observed."""
    rng = np.random.default_rng(0)
    W = np.round(rng.uniform(0, 640, (F, 2, P)), 3)
    return np.where(rng.random((F, P))[:, None] > 0.2, W, np.nan)


def cell(value: float) -> str:
    return "" if np.isnan(value) else repr(float(value))


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def read(path: Path, **asked: object) -> TrackFile:
    return read_csv(path, Asked(**asked))  # type: ignore[arg-type]


def refused(path: Path, *words: str, **asked: object) -> None:
    with pytest.raises(DatasetError) as caught:
        read(path, **asked)
    line = str(caught.value)
    assert all(word in line for word in words), line
    assert path.name in line and line.isprintable() and len(line) < 600 + len(str(path))


def deeplabcut(W: np.ndarray, animals: tuple[str, ...]) -> pd.DataFrame:
    """As DeepLabCut makes its tables; it writes positions of what it is not sure of."""
    own = [("DLC_resnet50", animal, node) for animal in animals for node in NODES]
    levels = ["scorer", "individuals", "bodyparts", "coords"]
    columns, values = [], []
    for p, key in enumerate(own):
        likely = np.where(np.isnan(W[:, 0, p]), 0.1, 0.98)
        for name, held in zip(("x", "y", "likelihood"), (*np.nan_to_num(W[:, :, p], nan=3.5).T, likely), strict=True):
            columns.append((*key, name))
            values.append(held)
    table = pd.DataFrame(np.transpose(values), columns=pd.MultiIndex.from_tuples(columns, names=levels))
    return table if len(animals) > 1 else table.droplevel("individuals", axis=1)


@pytest.mark.parametrize("animals", [ANIMALS, ANIMALS[:1]], ids=["four lines", "three lines"])
def test_deeplabcut(animals: tuple[str, ...], tracks: np.ndarray, tmp_path: Path) -> None:
    W = tracks[:, :, : len(animals) * len(NODES)]
    deeplabcut(W, animals).to_csv(tmp_path / "a.csv")
    found = read(tmp_path / "a.csv")
    np.testing.assert_array_equal(found.tracks, W)
    assert found.image and "confidence below 0.6" in found.notes[1]
    assert found.frames == tuple(map(str, range(F)))
    if len(animals) == 2:
        assert found.ids[:2] == ("ann.nose", "ann.tail_base") and found.bodies == ANIMALS
        np.testing.assert_array_equal(found.labels, np.arange(P) // 3)
    else:
        assert found.ids == NODES and found.labels is None
    assert not np.isnan(read(tmp_path / "a.csv", confidence=0.0).tracks).any()


def test_deeplabcut_of_labelled_frames(tmp_path: Path) -> None:
    """Images by name, in three columns in newer versions."""
    lines = ["scorer,,,me,me", "bodyparts,,,nose,nose", "coords,,,x,y"]
    images = [f"labeled-data,walk,img{k}.png,{k}.5,{k + 1}" for k in (10, 9, 100)]
    found = read(write(tmp_path / "a.csv", *lines, *images))
    assert found.frames == ("img9.png", "img10.png", "img100.png")
    np.testing.assert_array_equal(found.tracks[:, :, 0], [[9.5, 10], [10.5, 11], [100.5, 101]])


def test_sleap(tracks: np.ndarray, tmp_path: Path) -> None:
    header = "track,frame_idx,instance.score," + ",".join(f"{n}.x,{n}.y,{n}.score" for n in NODES)
    lines = [
        f"{animal},{f + 5},0.9," + ",".join(f"{cell(x)},{cell(y)},0.2" for x, y in tracks[f, :, 3 * a : 3 * a + 3].T)
        for a, animal in enumerate(ANIMALS)
        for f in range(F)
    ]
    found = read(write(tmp_path / "a.csv", header, *lines))
    np.testing.assert_array_equal(found.tracks, tracks)
    assert found.bodies == ANIMALS and found.ids[3] == "bob.nose" and found.frames[0] == "5"
    assert found.notes == ("read as SLEAP writes it", "not used: column instance.score")
    refused(write(tmp_path / "b.csv", header, lines[0], lines[0]), "frame '5', 'ann', occurs twice")


@pytest.mark.parametrize("separator", [", ", " ", "\t"])
def test_motchallenge(separator: str, tracks: np.ndarray, tmp_path: Path) -> None:
    """A track is the centre of its box; boxes whose flag is 0 are to be ignored."""
    lines = []
    for f, p in np.argwhere(~np.isnan(tracks[:, 0])):
        x, y = tracks[f, :, p]
        lines.append(separator.join(map(str, [f + 1, p + 1, x - 10, y - 30, 20, 60, 1 - (f == 2), -1, -1, -1])))
    found = read(write(tmp_path / "gt.txt", *lines))
    wanted = tracks.copy()
    wanted[2] = np.nan
    np.testing.assert_allclose(found.tracks, wanted, atol=1e-9)
    assert found.ids == tuple("123456") and found.image


def observations(W: np.ndarray, separator: str, comma: str = ".") -> list[str]:
    return [
        separator.join([f"img_{f}.png", f"p{p}", *(repr(float(v)).replace(".", comma) for v in W[f, :, p]), "7"])
        for f, p in np.argwhere(~np.isnan(W[:, 0]))
    ]


@pytest.mark.parametrize(("separator", "comma"), [(";", ","), (";", "."), ("\t", "."), (",", ".")])
def test_columns_that_the_user_names(separator: str, comma: str, tracks: np.ndarray, tmp_path: Path) -> None:
    header = separator.join(["img", "id", "u", "v", "speed"])
    W = np.concatenate([tracks, tracks])[:12]  # img_10 comes after img_9
    path = write(tmp_path / "a.csv", header, *observations(W, separator, comma))
    found = read(path, columns={"frame": "img", "track": "id", "x": "u", "y": "v"})
    np.testing.assert_array_equal(found.tracks, W)
    assert found.frames[9:] == ("img_9.png", "img_10.png", "img_11.png")
    assert found.notes == ("not used: column speed",)
    refused(path, "its header holds img, id, u, v, speed", "--columns frame=A,track=B,x=C,y=D")
    refused(path, "x='w' names no column", "it holds img, id, u, v", columns={"x": "w"})


@pytest.mark.parametrize("form", ["x_{}|y_{}", "{}_x|{}_y", "{}.x|{}.y", "{}_X|{}_Y"])
@pytest.mark.parametrize("frame", ["frame,", ",", ""])
def test_pairs_of_columns(form: str, frame: str, tracks: np.ndarray, tmp_path: Path) -> None:
    names = [f"p{p}" for p in range(P)]
    words = [word.format(name) for name in names for word in form.split("|")]
    lines = [(f"{f}," if frame else "") + ",".join(map(cell, W.T.ravel())) for f, W in enumerate(tracks)]
    found = read(write(tmp_path / "a.csv", frame + ",".join(words), *lines))
    np.testing.assert_array_equal(found.tracks, tracks)
    assert found.ids == tuple(names) and found.notes == ()


def test_confidence_of_pairs(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "time,a_x,a_y,a_conf", "0.1,1,2,0.9", "0.2,3,4,0.4")
    found = read(path)
    np.testing.assert_array_equal(found.tracks[:, :, 0], [[1, 2], [np.nan, np.nan]])
    assert found.notes == ("confidence below 0.5 counts as not observed (--confidence)", "not used: column time")
    timed = read(path, columns={"frame": "time"}, confidence=0.0)
    assert timed.frames == ("0.1", "0.2") and not np.isnan(timed.tracks).any()


@pytest.mark.parametrize(
    "frames",
    [
        ["img_2.png", "img_10.png", "img_9.png"],
        ["00:00:59.5", "00:01:00.25", "00:00:59.75"],
        ["walk/0001.jpg", "walk/0100.jpg", "walk/0020.jpg"],
        ["-3", "10", "9.5"],
    ],
)
def test_frames_are_sorted_by_their_numbers(frames: list[str], tmp_path: Path) -> None:
    lines = [f"{frame},a,{k},{k}" for k, frame in enumerate(frames)]
    found = read(write(tmp_path / "a.csv", "frame,track,x,y", *lines))
    assert found.frames == (frames[0], frames[2], frames[1])
    np.testing.assert_array_equal(found.tracks[:, 0, 0], [0, 2, 1])


def test_an_order_that_is_not_known_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "frame,track,x,y", "start,a,1,2", "end,a,1,2")
    refused(path, "which of the frames 'start' and 'end' comes first is not known; number the frames")


@pytest.mark.parametrize("lines", [["1,2,3", "4,5,6"], ["a b c"], ['"x'], ["frame,track,x,y", '0,a,1,"2'], [""]])
def test_other_texts_are_refused(lines: list[str], tmp_path: Path) -> None:
    refused(write(tmp_path / "a.txt", *lines))
