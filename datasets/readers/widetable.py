"""Wide tables: a line for each frame, or for each body in a frame. Empty cells are a gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.posetable import pose_tracks
from nrsfm.datasets.readers.textfile import Table
from nrsfm.datasets.readers.trackfile import TrackFile, check_size, check_words, named


@dataclass(frozen=True)
class Point:
    """The columns of one point; -1 for no confidence."""

    name: str
    x: int
    y: int
    confidence: int = -1
    body: str = ""


@dataclass(frozen=True)
class Wide:
    """Where a table holds what.

    Parameters
    ----------
    points : tuple of Point
        The columns of each.
    frame, body : int
        The columns of the frame, and of the body that a line is of; -1 for none. Without a frame, lines are counted
        from 0 on.
    least : float
        Confidence below which a position counts as not observed.
    skip : int
        Lines of the header.
    """

    points: tuple[Point, ...]
    frame: int = -1
    body: int = -1
    least: float = 0.0
    skip: int = 1
    notes: tuple[str, ...] = ()
    image: bool = False

    def read(self, table: Table) -> TrackFile:
        """The tracks of a table; DatasetError if a line does not fit or a frame comes twice."""
        path, N = table.path, len(self.points)
        if len({(point.body, point.name) for point in self.points}) < N:
            raise DatasetError(f"{path}: its header names a track twice; leave one of them out")
        check_words(path, "track", [point.name for point in self.points])
        check_size(path, 1, N)
        parts: list[Array] = []
        frames: list[str] = []
        bodies: list[str] = []
        for lines, rows in table.chunks(self.skip):
            check_size(path, len(frames) + len(rows), N)
            first = len(frames)
            frames += [row[self.frame].strip() if self.frame >= 0 else str(first + k) for k, row in enumerate(rows)]
            bodies += [row[self.body].strip() or "untracked" for row in rows] if self.body >= 0 else []
            parts.append(self._values(table, lines, rows))
        if not parts:
            raise DatasetError(f"{path}: it holds no observation; wanted a line for each frame, behind the header")
        nodes = [f"{point.body}.{point.name}" if point.body else point.name for point in self.points]
        found = pose_tracks(path, frames, bodies if self.body >= 0 else None, nodes, np.concatenate(parts))
        found = replace(found, notes=self.notes, image=self.image)
        if len({point.body for point in self.points}) == 1:
            return found
        labels, words = named(path, "individual", [point.body for point in self.points])
        return replace(found, labels=labels, bodies=words)

    def _values(self, table: Table, lines: Sequence[int], rows: Sequence[list[str]]) -> Array:
        """Positions (R, N, 2) in some lines."""
        columns = [k for point in self.points for k in (point.x, point.y)]
        cells = [row[k] for row in rows for k in columns]
        values = table.numbers(np.repeat(lines, len(columns)), "x or y", cells).reshape(len(rows), -1, 2)
        weighed = [k for k, point in enumerate(self.points) if point.confidence >= 0]
        if weighed and self.least > 0:
            cells = [row[self.points[k].confidence] for row in rows for k in weighed]
            sure = table.numbers(np.repeat(lines, len(weighed)), "confidence", cells).reshape(len(rows), -1)
            values[:, weighed] = np.where((sure < self.least)[:, :, None], np.nan, values[:, weighed])
        return values
