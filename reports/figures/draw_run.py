"""Draws one run: tracks, structure and affinity side by side."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import scipy.sparse as sp
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nrsfm.harness.evaluate.matching import matched
from nrsfm.harness.evaluate.metrics import brief
from nrsfm.harness.record.outcome import Outcome
from nrsfm.reports.figures.affinity import picture
from nrsfm.reports.figures.draw_chart import draw_blocks
from nrsfm.reports.figures.style import COLOURS, GREY, WRONG

DRAWN = 3000  # the most points that are drawn


def overview(arrays: Mapping[str, NDArray[Any]], outcome: Outcome, frame: int | None = None) -> Figure:
    """Image tracks, the reconstruction over the truth, and the sorted affinity, side by side.

    Parameters
    ----------
    arrays : mapping
        The contents of a trial's ``arrays.npz``: ``tracks`` (F, 2, P), and where the method gave them
        ``structure`` (F, 3, P), ``labels`` (P,), ``affinity`` (P, P), which may be sparse.
    frame : int, optional
        The frame drawn; the middle one by default.
    """
    tracks = arrays["tracks"]
    some = np.unique(np.linspace(0, tracks.shape[2] - 1, DRAWN).astype(int))
    frame = len(tracks) // 2 if frame is None else frame
    truth = arrays.get("true_labels")
    labels = matched(arrays["labels"], truth) if "labels" in arrays else None
    panels = ["tracks", *(name for name in ("structure", "affinity") if name in arrays)]
    figure = Figure(figsize=(4.4 * len(panels), 4.3), layout="constrained")
    for k, name in enumerate(panels, start=1):
        axes: Any = figure.add_subplot(1, len(panels), k, projection="3d" if name == "structure" else None)
        if name == "tracks":
            _tracks(axes, tracks[:, :, some], frame)
        elif name == "structure":
            shapes = {key: arrays[key][:, :, some] for key in ("structure", "true_structure") if key in arrays}
            shapes |= {key: arrays[key] for key in ("alignment",) if key in arrays}
            _structure(axes, shapes, frame, *(None if x is None else x[some] for x in (labels, truth)))
        else:
            _affinity(axes, arrays["affinity"], truth)
    words = [outcome.dataset.replace("_", " + "), outcome.method, *["procedural stand-in"] * outcome.stand_in]
    figure.suptitle(", ".join([*words, *brief(outcome.metrics, outcome.n_points)]), fontsize=11)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the suffix; the same figure gives the same bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(path.suffix[1:])
    with matplotlib.rc_context({"svg.hashsalt": "nrsfm"}):  # element names are random without it
        figure.savefig(path, dpi=150, metadata=metadata)


def _area(points: NDArray[Any]) -> float:
    """Scale of the markers: smaller for many points, so that they do not cover each other."""
    n: int = points.shape[-1]
    return min(1.0, 250 / n)


def _tracks(axes: Axes, tracks: NDArray[Any], frame: int) -> None:
    """The image of one frame, with the path of each point over the last frames."""
    tail = tracks[max(0, frame - 12) : frame + 1].transpose(2, 0, 1)
    axes.add_collection(LineCollection(list(tail), colors=GREY, linewidths=0.7 * _area(tracks)))
    axes.scatter(tracks[frame, 0], tracks[frame, 1], s=9 * _area(tracks), color="black", zorder=2)
    axes.set(title="tracks in the image", xlabel="x", ylabel="y", aspect="equal")
    axes.autoscale()


def _structure(
    axes: Any, arrays: Mapping[str, NDArray[Any]], frame: int, labels: NDArray[Any] | None, truth: NDArray[Any] | None
) -> None:
    X = arrays.get("alignment", np.eye(3)) @ arrays["structure"][frame]
    area = _area(X)
    if "true_structure" in arrays:
        axes.scatter(
            *arrays["true_structure"][frame], s=34 * area, facecolors="none", edgecolors=GREY, linewidths=0.7 * area
        )
    for label in [0] if labels is None else np.unique(labels):
        body = X if labels is None else X[:, labels == label]
        axes.scatter(*body, s=10 * area, color=COLOURS[int(label) % len(COLOURS)], depthshade=False)
    if labels is not None and truth is not None and (labels != truth).any():
        axes.scatter(*X[:, labels != truth], s=60, marker="x", color=WRONG, linewidths=1.2, depthshade=False)
    axes.view_init(elev=14, azim=-20)
    axes.set(title="structure over the truth (circles)", aspect="equal", xticklabels=[], yticklabels=[], zticklabels=[])


def _affinity(axes: Axes, affinity: NDArray[Any] | sp.sparray, truth: NDArray[Any] | None) -> None:
    A, edges = picture(affinity, truth)
    n = affinity.shape[0]
    draw_blocks(axes, A, edges * n / len(A), extent=(-0.5, n - 0.5, n - 0.5, -0.5))
    axes.set(title="affinity, tracks sorted by body", xlabel="track", ylabel="track")
