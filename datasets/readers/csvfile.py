"""Tracks in CSV files, long or wide; every complaint names the line.

Long: a line for each observation, in any order. A line that is not there is a gap::

    frame,track,x,y                 and, where they are known, label and visible
    0,nose,312.5,98.0

Wide: a line for each frame. Empty cells are a gap::

    x_nose,y_nose,x_chin,y_chin     or nose.x,nose.y,chin.x,chin.y; before them a column 'frame', if there is one
    312.5,98.0,,

The csv module splits the lines: pandas' parsers take a line that was cut short for a gap, and need 25 times as long for
a wide file of 29,000 tracks. pandas holds the table of observations.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.trackfile import MOST, TrackFile, check_size, check_words, in_order, named

if TYPE_CHECKING:
    import pandas as pd  # takes 0.3 s, which a wide file need not

LINE = 1 << 24  # characters of one line
CHUNK = 1 << 18  # cells that are text at the same time
SPARSE = 100  # of so many positions one must be observed, where there are many
NEEDED, KNOWN = ("frame", "track", "x", "y"), ("label", "visible")
VISIBLE = {"1": True, "true": True, "0": False, "false": False}

HEADERS = (
    "wanted the header frame,track,x,y[,label][,visible] with a line for each observation, or x_A,y_A,x_B,y_B,... or "
    "A.x,A.y,B.x,B.y,... with a line for each frame"
)


def read_csv(path: Path) -> TrackFile:
    """Read tracks from a CSV file, UTF-8 with commas, in one of the layouts above.

    An observation that is missing has no line, or empty or ``nan`` coordinates, or ``visible`` 0. Frames and tracks are
    named by numbers, which are sorted, or by any words, which stay in the order of the file. ``label`` is the same in
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
    """Lines of a file; DatasetError if one is longer than :data:`LINE`."""
    while line := stream.readline(LINE):
        if len(line) == LINE:
            raise DatasetError(f"{path}: a line has more than {LINE} characters; {HEADERS}")
        yield line


def _chunks(
    path: Path, header: Sequence[str], lines: Iterator[list[str]]
) -> Iterator[tuple[list[int], list[list[str]]]]:
    """Line numbers and cells, :data:`CHUNK` cells at a time; blank lines are left out."""
    filled = ((number, row) for number, row in enumerate(lines, start=2) if row)
    while chunk := list(islice(filled, max(1, CHUNK // max(1, len(header))))):
        for number, row in chunk:
            if len(row) != len(header):
                raise DatasetError(
                    f"{path}: line {number} has {len(row)} cells and the header {len(header)}; mend the line"
                )
        yield [number for number, _ in chunk], [row for _, row in chunk]


def _long(path: Path, header: list[str], lines: Iterator[list[str]]) -> TrackFile:
    table, names = _observations(path, header, lines)
    frame_names, frame_rank = in_order(path, "frame", list(names["frame"]))
    ids, track_rank = in_order(path, "track", list(names["track"]))
    F, P = len(frame_names), len(ids)
    check_size(path, F, P)
    most = max(1_000_000, SPARSE * len(table))
    if most < F * P:
        raise DatasetError(
            f"{path}: {len(table)} lines of {F} frames and {P} tracks are less than 1 in {SPARSE} observed; give a "
            "track one name in all frames that it is seen in"
        )
    f, p = frame_rank[table["frame"]], track_rank[table["track"]]
    twice = table.duplicated(["frame", "track"]).to_numpy()
    if twice.any():
        frame, track = frame_names[f[twice][0]][:40], ids[p[twice][0]][:40]
        raise DatasetError(f"{path}: frame {frame!a}, track {track!a} occurs twice; leave one of the lines out")
    W = np.full((F, 2, P), np.nan)
    W[f, :, p] = table[["x", "y"]]
    if "label" not in header:
        return TrackFile(W, frame_names, ids)
    words = _labels(path, table, list(names["track"]), list(names["label"]))
    words = [words[k] for k in np.argsort(track_rank)]
    if not any(words):
        return TrackFile(W, frame_names, ids)
    if "" in words:
        track = ids[words.index("")][:40]
        raise DatasetError(
            f"{path}: track {track!a} has no label and others have; label all tracks, or leave the column out"
        )
    labels, bodies = named(path, "label", words)
    return TrackFile(W, frame_names, ids, labels=labels, bodies=bodies)


def _observations(
    path: Path, header: list[str], lines: Iterator[list[str]]
) -> tuple[pd.DataFrame, dict[str, dict[str, int]]]:
    """A table of x, y and the indices of frame, track and label; and the index of each of their names."""
    import pandas as pd

    unknown = [word for word in header if word not in (*NEEDED, *KNOWN)]
    if unknown or len(set(header)) < len(header):
        fault = f"{unknown[0][:40]!a}, which is not known" if unknown else "a name twice"
        raise DatasetError(f"{path}: its header holds {fault}; {HEADERS}")
    names: dict[str, dict[str, int]] = {name: {} for name in ("frame", "track", "label") if name in header}
    parts: list[pd.DataFrame] = []
    n_lines = 0
    for numbers, rows in _chunks(path, header, lines):
        cells = dict(zip(header, zip(*rows, strict=True), strict=True))
        n_lines += len(rows)
        if n_lines > MOST:
            raise DatasetError(f"{path}: it holds more than {MOST} observations; leave some out")
        part = pd.DataFrame({name: _indices(known, cells[name]) for name, known in names.items()})
        check_size(path, len(names["frame"]), 1)
        check_size(path, 1, len(names["track"]))
        for name in ("x", "y"):
            part[name] = _coordinates(path, numbers, name, cells[name])
        if "visible" in cells:
            part.loc[~_visible(path, numbers, cells["visible"]), ["x", "y"]] = np.nan
        parts.append(part)
    if not parts:
        raise DatasetError(f"{path}: it holds no observation; {HEADERS}")
    return pd.concat(parts, ignore_index=True), names


def _labels(path: Path, table: pd.DataFrame, tracks: list[str], labels: list[str]) -> list[str]:
    """The label of each track; DatasetError if a track has two."""
    pairs = table[["track", "label"]].drop_duplicates().sort_values(["track", "label"])
    if (twice := pairs.loc[pairs["track"].duplicated(), "track"]).size:
        track = int(twice.iloc[0])
        both = " and ".join(ascii(labels[k][:40]) for k in pairs.loc[pairs["track"] == track, "label"][:2])
        raise DatasetError(f"{path}: track {tracks[track][:40]!a} has the labels {both}; give it one in all its lines")
    return [labels[k] for k in pairs["label"]]


def _wide(path: Path, header: list[str], lines: Iterator[list[str]]) -> TrackFile:
    framed = header[:1] == ["frame"]
    ids = _pairs(path, header[framed:])
    check_size(path, 1, len(ids))
    parts: list[Array] = []
    frames: dict[str, int] = {}
    for numbers, rows in _chunks(path, header, lines):
        first = len(frames)
        check_size(path, first + len(rows), len(ids))
        _indices(frames, [row[0] for row in rows] if framed else map(str, range(first, first + len(rows))))
        if len(frames) < first + len(rows):
            raise DatasetError(f"{path}: a frame occurs twice, in line {numbers[-1]} or before; leave one out")
        cells = [cell for row in rows for cell in row[framed:]]
        values = _coordinates(path, np.repeat(numbers, 2 * len(ids)), "x or y", cells)
        parts.append(values.reshape(len(rows), len(ids), 2))
    if not parts:
        raise DatasetError(f"{path}: it holds no observation; {HEADERS}")
    names, rank = in_order(path, "frame", list(frames))
    W = np.empty((len(names), 2, len(ids)))
    W[rank] = np.concatenate(parts).transpose(0, 2, 1)
    return TrackFile(W, names, ids)


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


def _indices(known: dict[str, int], words: Iterable[str]) -> list[int]:
    """Indices of words in the order in which they first came; new words are added to the known ones."""
    return [known.setdefault(word.strip(), len(known)) for word in words]


def _coordinates(path: Path, numbers: Sequence[int] | NDArray[np.int64], name: str, words: Sequence[str]) -> Array:
    """Finite numbers, NaN where a cell is empty; ``numbers`` are the lines of the words."""
    values = np.fromiter(map(_number, words), float, len(words))
    if (bad := np.flatnonzero(np.isinf(values))).size:
        wanted = "a finite number, or nothing where it is not observed"
        raise _misfit(path, int(numbers[bad[0]]), name, words[bad[0]], wanted)
    return values


def _number(word: str) -> float:
    """The value of a word, NaN if it is empty, and infinite if it is no number."""
    try:
        return math.inf if "_" in word else float(word)
    except ValueError:
        return math.inf if word.strip() else math.nan


def _visible(path: Path, numbers: Sequence[int], words: Sequence[str]) -> NDArray[np.bool_]:
    flags = [VISIBLE.get(word.strip().lower()) for word in words]
    if None in flags:
        k = flags.index(None)
        raise _misfit(path, numbers[k], "visible", words[k], "0 or 1")
    return np.array(flags, dtype=bool)


def _misfit(path: Path, number: int, name: str, word: str, wanted: str) -> DatasetError:
    return DatasetError(f"{path}: line {number}: {name} is {word[:40]!a}, wanted {wanted}")
