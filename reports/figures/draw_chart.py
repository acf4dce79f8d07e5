"""Draws a chart with matplotlib, for svg, pdf and png."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nrsfm.reports.figures.chart import Chart, Panel
from nrsfm.reports.figures.style import COLOURS, look

ACROSS = 4
"""The most panels side by side."""


def chart_figure(chart: Chart) -> Figure:
    """A figure with all panels of a chart and one legend below them."""
    n = len(chart.panels)
    across = min(ACROSS, n)
    down = -(-n // across)
    square = any(panel.matrix is not None for panel in chart.panels)
    figure = Figure(figsize=(3.3 * across + 0.4, (3.1 if square else 2.6) * down + 0.9), layout="constrained")
    entries: dict[str, Any] = {}
    for i, panel in enumerate(chart.panels):
        axes = figure.add_subplot(down, across, i + 1)
        _panel(axes, panel)
        handles, labels = axes.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.suptitle(chart.title, fontsize=12)
    if len(entries) > 1:
        widest = 0.085 * max(map(len, entries)) + 0.65  # inches
        columns = max(1, min(len(entries), int(figure.get_figwidth() / widest)))
        figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns, fontsize=9)
    return figure


def _panel(axes: Axes, panel: Panel) -> None:
    axes.set_title(panel.title, fontsize=9.5)
    axes.set_xlabel(panel.x, fontsize=9)
    axes.set_ylabel(panel.y, fontsize=9)
    axes.tick_params(labelsize=8)
    if panel.matrix is not None:
        draw_blocks(axes, panel.matrix, panel.edges)
        return
    for series in panel.series:
        style = look(series.place)
        x, y, spread = map(np.array, (series.x, series.y, series.spread))
        marker = style.marker if series.scatter or len(x) < 30 else ""
        line = "" if series.scatter else style.line
        axes.plot(
            x, y, color=style.colour, marker=marker, linestyle=line, markersize=4.5, linewidth=1.4, label=series.label
        )
        if series.spread:
            axes.fill_between(x, np.maximum(y - spread, 0), y + spread, color=style.colour, alpha=0.18, linewidth=0)
    axes.set(xscale="log" if panel.log_x else "linear", yscale="log" if panel.log_y else "linear")
    if panel.series and not panel.log_y:
        axes.set_ylim(bottom=0)
    axes.grid(color="#dddddd", linewidth=0.6)


def draw_blocks(axes: Axes, matrix: NDArray[Any], edges: Iterable[float], **options: Any) -> None:
    """A matrix in greys, with lines where its blocks begin; ``options`` are those of ``imshow``."""
    axes.imshow(matrix, cmap="Greys", interpolation="nearest", **options)
    for edge in edges:
        axes.axhline(edge - 0.5, color=COLOURS[1], linewidth=0.8)
        axes.axvline(edge - 0.5, color=COLOURS[1], linewidth=0.8)
