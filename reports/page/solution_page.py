"""One reconstruction as a page that needs nothing else: a 3D view to turn and play, the facts, and the curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from nrsfm.harness.record.curves import thinned
from nrsfm.harness.record.text import one_line
from nrsfm.reports.figures.affinity import picture
from nrsfm.reports.figures.blobs import Blobs
from nrsfm.reports.figures.style import COLOURS
from nrsfm.reports.formats.documents import html_environment
from nrsfm.reports.page.report_page import plotly, script_json, scripts

BUDGET = 12 << 20  # bytes of positions, before base64


FRAMES, POINTS = 300, 6000  # that are shown at most, evenly taken


SMALL = 1500  # points, above which markers are small


@dataclass(frozen=True)
class Shown:
    """What a page shows.

    Parameters
    ----------
    title : str
    facts : sequence of (name, value)
    structure, truth : (F, 3, P) array or None
        In the same axes and units.
    cameras : (F, 2, 3) array or None
        Give the direction to look from.
    labels : (P,) int array or None
    bodies : sequence of str
        Names of the labels.
    wrong : (P,) bool array or None
        Tracks whose label is not the true one.
    ids, frames : sequence of str
        Names of tracks and frames.
    edges : (E, 2) int array
    affinity : (P, P) array, sparse array or None
    history : mapping
        Curves by iteration.
    errors : (F,) array or None
        e_3D of each frame.
    """

    title: str
    facts: Sequence[tuple[str, str]]
    ids: Sequence[str]
    frames: Sequence[str]
    structure: NDArray[Any] | None = None
    truth: NDArray[Any] | None = None
    cameras: NDArray[Any] | None = None
    labels: NDArray[Any] | None = None
    bodies: Sequence[str] = ()
    wrong: NDArray[np.bool_] | None = None
    edges: NDArray[Any] | None = None
    affinity: Any = None
    history: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    errors: NDArray[Any] | None = None


def view(shown: Shown) -> str:
    """The page: HTML that loads nothing. What is too much for it is thinned evenly, and it says so.

    Raises
    ------
    UsageError
        If plotly is not installed.
    """
    blobs, told = Blobs(), ""
    run: dict[str, Any] = {}
    if shown.structure is not None:
        run["view"], told = _view(shown, blobs)
    run["curves"] = {
        name: {"x": steps.tolist(), "y": _short(values)}
        for name, (steps, values) in thinned({f"history_{k}": v for k, v in shown.history.items()}).items()
    }
    if shown.errors is not None:
        run["frames"] = _short(shown.errors)
    if shown.affinity is not None:
        A, edges = picture(shown.affinity, shown.labels)
        run["affinity"] = {"matrix": blobs.add(A, "uint8"), "edges": edges.tolist()}
    names = [] if shown.labels is None else [(_label(shown, k), _colour(k)) for k in np.unique(shown.labels).tolist()]
    return (
        html_environment()
        .get_template("solution.html.j2")
        .render(
            page=True,
            title=one_line(shown.title),
            facts=[(one_line(name, 60), one_line(value, 400)) for name, value in shown.facts],
            bodies=names,
            thinned=told,
            viewed="view" in run,
            data=script_json({"run": run, "blobs": blobs.held, "colours": COLOURS}),
            library=Markup(plotly()),
            script=scripts("player.js", "solution.js"),
        )
    )


def _view(shown: Shown, blobs: Blobs) -> tuple[dict[str, Any], str]:
    """The frames and points that are played, and what is left out of them."""
    S = shown.structure
    assert S is not None
    F, _, P = S.shape
    points = np.unique(np.linspace(0, P - 1, min(P, POINTS)).round().astype(int))
    copies = 1 if shown.truth is None else 2
    step = -(-F // int(np.clip(BUDGET // (6 * copies * len(points)), 8, FRAMES)))
    turned = np.eye(3) if shown.truth is not None or shown.cameras is None else _facing(shown.cameras[0])
    data: dict[str, Any] = {"step": step, "total": F, "size": 4 if len(points) <= SMALL else 2}
    for name, X in (("found", S), ("truth", shown.truth)):
        if X is not None:
            X = X[::step][:, :, points]
            data[name] = blobs.add(turned @ (X - np.nanmean(X, axis=2, keepdims=True)), "int16")
    eye = np.array([1.0, -2.1, 0.6])
    if shown.truth is not None and shown.cameras is not None:
        eye = _facing(shown.cameras[0]).T @ eye
    data["eye"] = dict(zip("xyz", _short(eye), strict=True))
    data["ids"] = [one_line(shown.ids[p], 60) for p in points.tolist()]
    if list(shown.frames) != list(map(str, range(F))):
        data["frames"] = [one_line(name, 60) for name in shown.frames[::step]]
    if shown.labels is not None:
        data["labels"] = shown.labels[points].tolist()
        data["bodies"] = {k: _label(shown, k) for k in np.unique(shown.labels).tolist()}
    if shown.wrong is not None:
        data["wrong"] = np.flatnonzero(shown.wrong[points]).tolist()
    if shown.edges is not None and len(points) == P:
        data["edges"] = shown.edges.tolist()
    told = []
    if step > 1:
        told.append(f"{len(range(0, F, step))} of {F} frames")
    if len(points) < P:
        told.append(f"{len(points)} of {P} tracks")
    return data, f"The view shows {' and '.join(told)}, evenly taken; the files hold all." if told else ""


def _facing(camera: NDArray[Any]) -> NDArray[Any]:
    """The rotation (3, 3) into axes of an image: x to the right, y into the depth, z upwards."""
    right, up = camera
    return np.stack([right, np.cross(up, right), up])


def _label(shown: Shown, k: int) -> str:
    """``walker (41 tracks)``."""
    assert shown.labels is not None
    n = int((shown.labels == k).sum())
    return f"{one_line(shown.bodies[k], 60)} ({n} track{'' if n == 1 else 's'})"


def _colour(k: int) -> str:
    return COLOURS[k % len(COLOURS)]


def _short(values: NDArray[Any]) -> list[float | None]:
    """Six significant digits; None where there is no number."""
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in values.tolist()]
