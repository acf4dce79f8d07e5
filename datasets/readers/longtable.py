"""Long tables: a line for each observation, in any order. A line that is not there is a gap."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.textfile import Table
from nrsfm.datasets.readers.trackfile import MOST, TrackFile, check_size, in_order, named

if TYPE_CHECKING:
    import pandas as pd  # takes 0.3 s, which other files need not

SPARSE = 100  # of so many positions one must be observed, where there are many
VISIBLE = {"1": True, "true": True, "0": False, "false": False}


@dataclass(frozen=True)
class Long:
    """Where a table holds what: a column for each of ``frame``, ``track``, ``x`` and ``y``.

    There may be columns for ``label``, ``visible``, and ``confidence``, below ``least`` of which a position counts as
    not observed; ``flag``, 0 for what is to be ignored; and ``width`` and ``height`` of boxes, of which x and y are a
    corner.
    """

    columns: Mapping[str, int]
    least: float = 0.0
    skip: int = 1
    notes: tuple[str, ...] = ()
    image: bool = False

    def read(self, table: Table) -> TrackFile:
        """The tracks of a table.

        Raises
        ------
        DatasetError
            If a line does not fit, an observation comes twice, or a track has two labels.
        """
        path = table.path
        seen, names = _observations(table, self)
        frames, frame_rank = in_order(path, "frame", list(names["frame"]))
        ids, track_rank = in_order(path, "track", list(names["track"]))
        F, P = len(frames), len(ids)
        check_size(path, F, P)
        if max(1_000_000, SPARSE * len(seen)) < F * P:
            raise DatasetError(
                f"{path}: {len(seen)} lines of {F} frames and {P} tracks are less than 1 in {SPARSE} observed; give a "
                "track one name in all frames that it is seen in"
            )
        f, p = frame_rank[seen["frame"]], track_rank[seen["track"]]
        if (twice := seen.duplicated(["frame", "track"]).to_numpy()).any():
            frame, track = frames[f[twice][0]][:40], ids[p[twice][0]][:40]
            raise DatasetError(f"{path}: frame {frame!a}, track {track!a} occurs twice; leave one of the lines out")
        W = np.full((F, 2, P), np.nan)
        W[f, :, p] = seen[["x", "y"]]
        labels, bodies = _labels(table, seen, names, track_rank) if "label" in names else (None, ())
        return TrackFile(W, frames, ids, labels=labels, bodies=bodies, notes=self.notes, image=self.image)


def _observations(table: Table, plan: Long) -> tuple[pd.DataFrame, dict[str, dict[str, int]]]:
    """A table of x, y and the indices of frame, track and label; and the index of each of their names."""
    import pandas as pd

    names: dict[str, dict[str, int]] = {name: {} for name in ("frame", "track", "label") if name in plan.columns}
    parts: list[pd.DataFrame] = []
    n_lines = 0
    for lines, rows in table.chunks(plan.skip):
        cells = {name: [row[k] for row in rows] for name, k in plan.columns.items()}
        n_lines += len(rows)
        if n_lines > MOST:
            raise DatasetError(f"{table.path}: it holds more than {MOST} observations; leave some out")
        part = pd.DataFrame({name: _indices(known, cells[name]) for name, known in names.items()})
        check_size(table.path, len(names["frame"]), 1)
        check_size(table.path, 1, len(names["track"]))
        for name, size in (("x", "width"), ("y", "height")):
            part[name] = table.numbers(lines, name, cells[name])
            if size in cells:
                part[name] += table.numbers(lines, size, cells[size]) / 2
        if "visible" in cells:
            part.loc[~_visible(table, lines, cells["visible"]), ["x", "y"]] = np.nan
        if "flag" in cells:
            part.loc[table.numbers(lines, "flag", cells["flag"]) == 0, ["x", "y"]] = np.nan
        if "confidence" in cells:
            part.loc[table.numbers(lines, "confidence", cells["confidence"]) < plan.least, ["x", "y"]] = np.nan
        parts.append(part)
    if not parts:
        raise DatasetError(f"{table.path}: it holds no observation; wanted a line for each, behind the header")
    return pd.concat(parts, ignore_index=True), names


def _labels(
    table: Table, seen: pd.DataFrame, names: Mapping[str, dict[str, int]], track_rank: NDArray[np.int64]
) -> tuple[NDArray[np.int64] | None, tuple[str, ...]]:
    """Labels of the tracks and their names; None if all are empty."""
    path, tracks, words = table.path, list(names["track"]), list(names["label"])
    pairs = seen[["track", "label"]].drop_duplicates().sort_values(["track", "label"])
    if (twice := pairs.loc[pairs["track"].duplicated(), "track"]).size:
        track = int(twice.iloc[0])
        both = " and ".join(ascii(words[k][:40]) for k in pairs.loc[pairs["track"] == track, "label"][:2])
        raise DatasetError(f"{path}: track {tracks[track][:40]!a} has the labels {both}; give it one in all its lines")
    of_track = [words[k] for k in pairs["label"]]
    if not any(of_track):
        return None, ()
    if "" in of_track:
        bare = tracks[of_track.index("")][:40]
        raise DatasetError(
            f"{path}: track {bare!a} has no label and others have; label all tracks, or leave the column out"
        )
    return named(path, "label", [of_track[k] for k in np.argsort(track_rank)])


def _indices(known: dict[str, int], words: Iterable[str]) -> list[int]:
    """Indices of words in the order in which they first came; new words are added to the known ones."""
    return [known.setdefault(word.strip(), len(known)) for word in words]


def _visible(table: Table, lines: Sequence[int], words: Sequence[str]) -> NDArray[np.bool_]:
    flags = [VISIBLE.get(word.strip().lower()) for word in words]
    if None in flags:
        k = flags.index(None)
        raise table.misfit(lines[k], "visible", words[k], "0 or 1")
    return np.array(flags, dtype=bool)
