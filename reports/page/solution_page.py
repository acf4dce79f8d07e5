"""A solution as one standalone page: a 3D view to turn and play, the facts, and the curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.harness.record.text import one_line
from nrsfm.reports.figures.page_data import Blobs, evenly, rounded
from nrsfm.reports.figures.style import COLOURS
from nrsfm.reports.page.standalone import render_page
from nrsfm.reports.page.view3d import plot_data, view_data

BUDGET = 12 << 20  # bytes of positions, before base64

FRAMES, POINTS = 300, 6000  # the most that the view shows, evenly taken

SMALL = 1500  # points, above which markers are small


@dataclass(frozen=True)
class Shown:
    """The contents of the page."""

    title: str
    facts: Sequence[tuple[str, str]]  #: names and values
    ids: Sequence[str]  #: names of the tracks
    frames: Sequence[str]  #: names of the frames
    structure: NDArray[Any] | None = None  #: (F, 3, P)
    truth: NDArray[Any] | None = None  #: (F, 3, P), in the same axes and units
    cameras: NDArray[Any] | None = None  #: (F, 2, 3), for the direction of view
    labels: NDArray[Any] | None = None  #: (P,)
    bodies: Sequence[str] = ()  #: names of the labels
    wrong: NDArray[np.bool_] | None = None  #: (P,), whether a track's label is not the true one
    edges: NDArray[Any] | None = None  #: (E, 2)
    affinity: Any = None  #: (P, P) array or sparse array
    history: Mapping[str, NDArray[Any]] = field(default_factory=dict)  #: curves of the method by iteration
    errors: NDArray[Any] | None = None  #: (F,), e_3D of each frame


def view(shown: Shown) -> str:
    """The page as HTML that loads nothing from elsewhere; it says so where it shows a part of the frames or tracks.

    Raises
    ------
    UsageError
        If plotly is not installed.
    """
    blobs = Blobs()
    history = {f"history_{name}": values for name, values in shown.history.items()}
    run, remark = plot_data(blobs, history, shown.errors, shown.affinity, shown.labels), ""
    if shown.structure is not None:
        run["view"], remark = _view(shown, shown.structure, blobs)
    return render_page(
        "solution",
        {"run": run},
        blobs,
        title=one_line(shown.title),
        facts=[(one_line(name, 60), one_line(value, 400)) for name, value in shown.facts],
        bodies=[(label, COLOURS[k % len(COLOURS)]) for k, label in _body_labels(shown).items()],
        thinned=remark,
        viewed="view" in run,
    )


def _view(shown: Shown, S: NDArray[Any], blobs: Blobs) -> tuple[dict[str, Any], str]:
    """Data of the 3D view, and a remark on the frames and points that it leaves out."""
    F, _, P = S.shape
    points = evenly(P, POINTS)
    copies = 1 if shown.truth is None else 2
    frames = int(np.clip(BUDGET // (6 * copies * len(points)), 8, FRAMES))
    eye = np.array([1.0, -2.1, 0.6])
    if shown.cameras is not None:
        right, up = shown.cameras[0]
        facing = np.stack([right, np.cross(up, right), up])  # x to the right, y into the depth, z upwards
        if shown.truth is None:
            S = facing @ S
        else:
            eye = facing.T @ eye
    data = view_data(blobs, S, shown.truth, shown.labels, shown.wrong, shown.edges, frames=frames, points=POINTS)
    step = data["step"]
    data["size"] = 4 if len(points) <= SMALL else 2
    data["eye"] = dict(zip("xyz", rounded(eye.tolist()), strict=True))
    data["ids"] = [one_line(shown.ids[p], 60) for p in points.tolist()]
    if list(shown.frames) != list(map(str, range(F))):
        data["frames"] = [one_line(name, 60) for name in shown.frames[::step]]
    if shown.labels is not None:
        data["bodies"] = _body_labels(shown)
    parts = [(len(range(0, F, step)), F, "frames"), (len(points), P, "tracks")]
    left_out = " and ".join(f"{some} of {whole} {name}" for some, whole, name in parts if some < whole)
    return data, f"The view shows {left_out}, evenly taken; the files hold all." if left_out else ""


def _body_labels(shown: Shown) -> dict[int, str]:
    """Label -> ``walker (41 tracks)``."""
    if shown.labels is None:
        return {}
    counts = zip(*(part.tolist() for part in np.unique(shown.labels, return_counts=True)), strict=True)
    return {k: f"{one_line(shown.bodies[k], 60)} ({n} track{'' if n == 1 else 's'})" for k, n in counts}
