"""Tracks as CSV from strangers: bounded, strict, and every complaint names the line.

Long, a line for each observation, in any order; a line that is not there is a gap::

    frame,track,x,y                 and, where they are known, label and visible
    0,nose,312.5,98.0

Wide, a line for each frame; empty cells are a gap::

    x_nose,y_nose,x_chin,y_chin     or nose.x,nose.y,chin.x,chin.y; before them a column 'frame', if there is one
    312.5,98.0,,
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import IO, TypeVar

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.trackfields import MOST, Parts, check_size, check_words, named, order

T = TypeVar("T")


LINE = 1 << 24  # characters of one line


CHUNK = 1 << 18  # cells that are taken in at once


SPARSE = 100  # of so many positions one must be observed, where there are many


NEEDED, KNOWN = ("frame", "track", "x", "y"), ("label", "visible")


YES, NO = ("1", "true"), ("0", "false")


HEADERS = (
    "wanted the header frame,track,x,y[,label][,visible] with a line for each observation, or x_A,y_A,x_B,y_B,... or "
    "A.x,A.y,B.x,B.y,... with a line for each frame"
)


def read_csv(path: Path) -> Parts:
    """Read tracks from a CSV file, UTF-8 with commas, long or wide as the module says.

    An observation that is missing has no line, or empty or ``nan`` coordinates, or ``visible`` 0. Frames and tracks are
    called by numbers, which are sorted, or by any words, which stay in the order of the file. ``label`` is the same in
    all lines of a track.

    Raises
    ------
    DatasetError
        If the file is no such text or too large, its header is another, or a line does not fit.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            lines = csv.reader(_lines(path, stream), strict=True)
            header = [word.strip() for word in next(lines, [])]
            read = _long if set(NEEDED) <= set(header) else _wide
            return read(path, header, lines)
    except (csv.Error, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DatasetError(f"{path}: not a readable CSV file ({reason}); save it as UTF-8 text with commas") from None


def _lines(path: Path, stream: IO[str]) -> Iterator[str]:
    while line := stream.readline(LINE):
        if len(line) == LINE:
            raise DatasetError(f"{path}: a line has more than {LINE} characters; {HEADERS}")
        yield line


def _chunks(
    path: Path, header: Sequence[str], lines: Iterator[list[str]]
) -> Iterator[tuple[Sequence[int], list[list[str]]]]:
    """Rows, some at a time, each as long as the header, and the numbers of their lines; blank lines are left out."""
    first = 2
    while rows := list(islice(lines, max(1, CHUNK // max(1, len(header))))):
        numbers = [first + k for k, row in enumerate(rows) if row]
        first += len(rows)
        rows = [row for row in rows if row]
        for number, row in zip(numbers, rows, strict=True):
            if len(row) != len(header):
                raise DatasetError(
                    f"{path}: line {number} has {len(row)} cells and the header {len(header)}; mend the line"
                )
        if rows:
            yield numbers, rows


def _long(path: Path, header: list[str], lines: Iterator[list[str]]) -> Parts:
    unknown = [word for word in header if word not in (*NEEDED, *KNOWN)]
    if unknown or len(set(header)) < len(header):
        what = f"{unknown[0][:40]!a}, which is not known" if unknown else "a name twice"
        raise DatasetError(f"{path}: its header holds {what}; {HEADERS}")
    frames, tracks, bodies = _Words(), _Words(), _Words()
    parts: list[tuple[NDArray[np.int64], NDArray[np.int64], Array]] = []
    labels: dict[int, int] = {}
    n_seen = 0
    for numbers, rows in _chunks(path, header, lines):
        column = dict(zip(header, zip(*rows, strict=True), strict=True))
        f, p = frames.places(column["frame"]), tracks.places(column["track"])
        xy = np.stack([_values(path, numbers, name, column[name]) for name in "xy"])
        if "visible" in column:
            xy[:, ~np.array(_parsed(path, numbers, "visible", column["visible"], _seen))] = np.nan
        n_seen += len(rows)
        check_size(path, len(frames.held), 1)
        check_size(path, 1, len(tracks.held))
        if n_seen > MOST:
            raise DatasetError(f"{path}: it holds more than {MOST} observations; leave some out")
        if "label" in column:
            for track, label in set(zip(p.tolist(), bodies.places(column["label"]).tolist(), strict=True)):
                if labels.setdefault(track, label) != label:
                    name, said = (
                        ascii(tracks.names[track][:40]),
                        " and ".join(ascii(bodies.names[k][:40]) for k in sorted((labels[track], label))),
                    )
                    raise DatasetError(f"{path}: track {name} has the labels {said}; give it one in all its lines")
        parts.append((f, p, xy))
    if not parts:
        raise DatasetError(f"{path}: it holds no observation; {HEADERS}")
    f, p, xy = (np.concatenate(arrays, axis=-1) for arrays in zip(*parts, strict=True))
    frame_names, frame_rank = _sorted(path, "frame", frames)
    ids, track_rank = _sorted(path, "track", tracks)
    F, P = len(frame_names), len(ids)
    _check_filled(path, F, P, n_seen)
    f, p = frame_rank[f], track_rank[p]
    flat = np.sort(f * P + p)
    if (twice := flat[1:][flat[1:] == flat[:-1]]).size:
        frame, track = frame_names[twice[0] // P][:40], ids[twice[0] % P][:40]
        raise DatasetError(f"{path}: frame {frame!a}, track {track!a} stands there twice; leave one of the lines out")
    W = np.full((F, 2, P), np.nan)
    W[f, :, p] = xy.T
    truth, called = _labels(path, ids, track_rank, labels, bodies.names)
    return Parts(W, frame_names, ids, labels=truth, bodies=called)


def _labels(
    path: Path, ids: Sequence[str], rank: NDArray[np.int64], labels: dict[int, int], bodies: list[str]
) -> tuple[NDArray[np.int64] | None, tuple[str, ...]]:
    """Labels of the sorted tracks, and what they are called; nothing where no line has one."""
    words = [""] * len(ids)
    for track, label in labels.items():
        words[rank[track]] = bodies[label]
    if not any(words):
        return None, ()
    if "" in words:
        raise DatasetError(
            f"{path}: track {ids[words.index('')][:40]!a} has no label and others have; label all tracks, or leave the "
            "column out"
        )
    return named(path, "label", words)


def _check_filled(path: Path, n_frames: int, n_points: int, n_seen: int) -> None:
    """Raise DatasetError if an array of all positions would be large, or large beside what the file holds."""
    check_size(path, n_frames, n_points)
    if n_frames * n_points > max(1_000_000, SPARSE * n_seen):
        raise DatasetError(
            f"{path}: {n_seen} lines of {n_frames} frames and {n_points} tracks are less than 1 in {SPARSE} observed; "
            "give a track one name in all frames that it is seen in"
        )


def _wide(path: Path, header: list[str], lines: Iterator[list[str]]) -> Parts:
    framed = header[:1] == ["frame"]
    ids = _pairs(path, header[framed:])
    check_size(path, 1, len(ids))
    parts, frames = [], _Words()
    for numbers, rows in _chunks(path, header, lines):
        before = len(frames.held)
        check_size(path, before + len(rows), len(ids))
        frames.places([row[0] for row in rows] if framed else list(map(str, range(before, before + len(rows)))))
        if len(frames.held) < before + len(rows):
            raise DatasetError(f"{path}: a frame stands there twice, in line {numbers[-1]} or before; leave one out")
        cells = [cell for row in rows for cell in row[framed:]]
        parts.append(_values(path, np.repeat(numbers, 2 * len(ids)), "x or y", cells).reshape(len(rows), len(ids), 2))
    if not parts:
        raise DatasetError(f"{path}: it holds no observation; {HEADERS}")
    names, rank = _sorted(path, "frame", frames)
    W = np.empty((len(names), 2, len(ids)))
    W[rank] = np.concatenate(parts).transpose(0, 2, 1)
    return Parts(W, names, ids)


def _pairs(path: Path, header: list[str]) -> tuple[str, ...]:
    """The tracks that the columns x_A, y_A or A.x, A.y of a wide file belong to."""
    ids = []
    for x, y in zip(header[::2], [*header[1::2], ""], strict=False):
        if x.startswith("x_") and y == f"y_{x[2:]}":
            ids.append(x[2:])
        elif x.endswith(".x") and y == f"{x[:-2]}.y":
            ids.append(x[:-2])
        else:
            raise DatasetError(f"{path}: its header holds {x[:40]!a} and then {y[:40]!a}; {HEADERS}")
    if not ids or len(set(ids)) < len(ids):
        raise DatasetError(f"{path}: its header names {'a track twice' if ids else 'no track'}; {HEADERS}")
    check_words(path, "track", ids)
    return tuple(ids)


class _Words:
    """Words by the order in which they first came."""

    def __init__(self) -> None:
        self.held: dict[str, int] = {}

    def places(self, words: Sequence[str]) -> NDArray[np.int64]:
        held = self.held
        return np.array([held.setdefault(word, len(held)) for word in map(str.strip, words)], dtype=np.int64)

    @property
    def names(self) -> list[str]:
        return list(self.held)


def _sorted(path: Path, field: str, words: _Words) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Names in order, numbers by value and other words as they came; and the rank of each by the place it had."""
    names = words.names
    check_words(path, field, names)
    keys = [order(name) for name in names]
    places = list(range(len(names)))
    if not any(key[0] for key in keys):
        places.sort(key=keys.__getitem__)
    rank = np.empty(len(names), dtype=np.int64)
    rank[places] = np.arange(len(names))
    return tuple(names[k] for k in places), rank


def _values(path: Path, numbers: Sequence[int] | NDArray[np.int64], name: str, words: Sequence[str]) -> Array:
    """Coordinates; NaN where a cell is empty."""
    try:
        found = np.array(list(map(float, words)))  # what files mostly hold
        if not np.isinf(found).any() and "_" not in "".join(words):
            return found
    except ValueError:
        pass
    return np.array(_parsed(path, numbers, name, words, _number))


def _number(word: str) -> float:
    word = word.strip()
    value = float(word) if word else math.nan
    if math.isinf(value) or "_" in word:
        raise ValueError
    return value


def _seen(word: str) -> bool:
    word = word.strip().lower()
    if word not in (*YES, *NO):
        raise ValueError
    return word in YES


def _parsed(
    path: Path,
    numbers: Sequence[int] | NDArray[np.int64],
    name: str,
    words: Sequence[str],
    parse: Callable[[str], T],
) -> list[T]:
    """Every word parsed, which stands in the line of its number."""
    found = []
    try:
        for word in words:
            found.append(parse(word))
    except ValueError:
        wanted = "0 or 1" if name == "visible" else "a finite number, or nothing where it is not observed"
        said = ascii(words[len(found)][:40])
        raise DatasetError(f"{path}: line {numbers[len(found)]}: {name} is {said}, wanted {wanted}") from None
    return found
