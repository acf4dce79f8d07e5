"""A chart as data: panels of lines or of a matrix. The figure files and the page are drawn from it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.reports.figures.page_data import Blobs, rounded
from nrsfm.reports.figures.style import look


@dataclass(frozen=True)
class Series:
    """One line: points, and the half height of the band around them (empty for none)."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    spread: tuple[float, ...] = ()
    place: int = 0
    scatter: bool = False


@dataclass(frozen=True)
class Panel:
    """A pair of axes: lines, or a matrix (rows, columns) with ``edges`` where its blocks begin."""

    title: str
    x: str
    y: str
    series: tuple[Series, ...] = ()
    matrix: NDArray[np.float64] | None = field(default=None, compare=False)
    edges: tuple[int, ...] = ()
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True)
class Chart:
    """Panels under one title; ``name`` is the stem of its files."""

    name: str
    title: str
    caption: str
    panels: tuple[Panel, ...]

    def data(self, blobs: Blobs) -> dict[str, Any]:
        """The chart as plain data; its matrices are added to ``blobs``."""
        return {"title": self.title, "panels": [_panel(panel, blobs) for panel in self.panels]}


def _panel(panel: Panel, blobs: Blobs) -> dict[str, Any]:
    data: dict[str, Any] = {name: getattr(panel, name) for name in ("title", "x", "y", "edges", "log_x", "log_y")}
    data["matrix"] = None if panel.matrix is None else blobs.add(panel.matrix, "uint8")
    data["series"] = [
        {
            "label": series.label,
            "x": rounded(series.x),
            "y": rounded(series.y),
            "spread": rounded(series.spread),
            "scatter": series.scatter,
            "look": {name: getattr(look(series.place), name) for name in ("colour", "symbol", "dash")},
        }
        for series in panel.series
    ]
    return data
