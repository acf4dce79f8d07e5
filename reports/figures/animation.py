"""Tracks in the image beside the bodies in 3D: as a moving picture, the bodies turning, or as one frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from nrsfm.reports.figures.style import COLOURS, GREY

FRAMES = 72
"""The most frames of a picture, evenly taken."""
SECONDS = 0.08
TAIL = 10
"""Frames over which a track is drawn behind its point."""
TURN = 180.0
"""Degrees that the view turns over the picture."""


def animate(
    path: Path,
    tracks: NDArray[np.floating],
    structure: NDArray[np.floating],
    labels: NDArray[np.int64] | None = None,
    edges: NDArray[np.int64] | None = None,
    dpi: int = 80,
) -> None:
    """Write a GIF of a solution.

    Parameters
    ----------
    path : Path
        Replaced if it is there.
    tracks : (F, 2, P) array
        NaN where a track is not observed.
    structure : (F, 3, P) array
    labels : (P,) array, optional
        The body of each track, by which it is coloured.
    edges : (E, 2) array, optional
        Pairs of points that are joined by a line in 3D.
    dpi : int
        Dots an inch of a picture of 8 x 4 inches.
    """
    chosen = np.unique(np.linspace(0, len(tracks) - 1, FRAMES).astype(int))
    angles = -60 + TURN * np.arange(len(chosen)) / len(chosen)
    pictures = [
        Image.fromarray(picture).quantize(48)
        for picture in _pictures(tracks, structure, labels, edges, dpi, list(zip(chosen.tolist(), angles, strict=True)))
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    timing = {"duration": int(1000 * SECONDS), "loop": 0}
    pictures[0].save(path, format="GIF", save_all=True, append_images=pictures[1:], optimize=True, **timing)


def still(
    tracks: NDArray[np.floating],
    structure: NDArray[np.floating],
    labels: NDArray[np.int64] | None = None,
    edges: NDArray[np.int64] | None = None,
    dpi: int = 80,
) -> bytes:
    """The middle frame of :func:`animate` as PNG."""
    (picture,) = _pictures(tracks, structure, labels, edges, dpi, [(len(tracks) // 2, -60.0)])
    file = BytesIO()
    Image.fromarray(picture).quantize(64).save(file, format="PNG", optimize=True)
    return file.getvalue()


def _pictures(
    tracks: NDArray[np.floating],
    structure: NDArray[np.floating],
    labels: NDArray[np.int64] | None,
    edges: NDArray[np.int64] | None,
    dpi: int,
    views: Sequence[tuple[int, float]],
) -> Iterator[NDArray[np.uint8]]:
    """A picture (height, width, 3) for each frame and angle of view."""
    colours = np.array(COLOURS)[(np.zeros(tracks.shape[2], int) if labels is None else labels) % len(COLOURS)]
    figure = Figure(figsize=(8, 4), dpi=dpi, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    image = figure.add_axes((0.01, 0.02, 0.48, 0.88))
    space: Any = figure.add_axes((0.48, -0.08, 0.54, 1.04), projection="3d")
    for x, title in ((0.25, "2D tracks"), (0.75, "bodies in 3D")):
        figure.text(x, 0.94, title, fontsize=11, ha="center")
    shown = structure[[frame for frame, _ in views]]
    limits = np.nanmin(shown, axis=(0, 2)), np.nanmax(shown, axis=(0, 2))
    middle, radius = (limits[0] + limits[1]) / 2, float((limits[1] - limits[0]).max()) / 2
    for frame, angle in views:
        _draw_image(image, tracks, frame)
        _draw_space(space, structure[frame], colours, edges, middle, radius)
        space.view_init(elev=12, azim=angle)
        canvas.draw()
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _draw_image(axes: Axes, tracks: NDArray[np.floating], frame: int) -> None:
    axes.clear()
    tail = tracks[max(0, frame - TAIL) : frame + 1].transpose(2, 0, 1)
    axes.add_collection(LineCollection(list(tail), colors=GREY, linewidths=0.8))
    axes.scatter(tracks[frame, 0], tracks[frame, 1], s=10, color="black", zorder=2)
    low, high = np.nanmin(tracks, axis=(0, 2)), np.nanmax(tracks, axis=(0, 2))
    margin = 0.05 * (high - low).max()
    axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin), aspect="equal")
    axes.set_axis_off()


def _draw_space(
    axes: Any,
    X: NDArray[np.floating],
    colours: NDArray[np.str_],
    edges: NDArray[np.int64] | None,
    middle: NDArray[np.floating],
    radius: float,
) -> None:
    axes.clear()
    for start, end in [] if edges is None else edges:
        axes.plot(*X[:, [start, end]], color=colours[start], linewidth=1.4, alpha=0.8)
    axes.scatter(*X, s=10, c=colours, depthshade=False)
    for axis, centre in zip("xyz", middle, strict=True):
        getattr(axes, f"set_{axis}lim")(centre - radius, centre + radius)
    axes.set_box_aspect((1, 1, 1), zoom=1.45)
    axes.set_axis_off()
