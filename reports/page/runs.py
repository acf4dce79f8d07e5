"""The runs behind the cells as plain data for the page: settings, numbers, curves, and what its 3D view plays.

Positions travel as 16-bit integers, base64; the same array (the truth of a scene, a structure that two pipelines
share) travels once.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.harness.evaluate.matching import matched
from nrsfm.harness.record.curves import thinned
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.tracked import Arrays, Fetch, Tracked
from nrsfm.reports.figures.affinity import picture
from nrsfm.reports.figures.blobs import Blobs
from nrsfm.reports.tables.model import Run

BUDGET = 6 << 20
"""Bytes of positions in a page, before base64."""


FRAMES = 100
"""Frames of a sequence that the 3D view plays at most; evenly taken."""


POINTS = 1000
"""Points that it shows at most; evenly taken."""


def details(runs: Iterable[Tracked], fetch: Fetch, viewed: Iterable[str]) -> tuple[dict[str, Any], Blobs]:
    """Everything that the page tells of each run, by trial key.

    Parameters
    ----------
    runs : iterable of Tracked
    fetch : callable
        Gives a run's arrays.
    viewed : iterable of str
        Keys of the runs that get a 3D view, as far as they gave a structure and the truth is known.

    Returns
    -------
    dict, Blobs
        Plain data, and the arrays that it names.
    """
    once = {run.outcome.key: run for run in runs}
    views = set(viewed)
    size = sum(
        12
        * min(  # truth and estimate
            run.outcome.n_points or 0, POINTS
        )
        for key, run in once.items()
        if _has_view(run, key in views)
    )
    n_frames = int(np.clip(BUDGET // max(size, 1), 8, FRAMES))
    blobs = Blobs()
    told = {}
    for key, run in once.items():
        entry = _words(run)
        arrays = fetch(run) if key in views else {}
        if arrays:
            entry["curves"] = {name: _points(*curve) for name, curve in thinned(arrays).items()}
            if "frame_e_3d" in arrays:
                entry["frames"] = [_short(v) if np.isfinite(v) else None for v in arrays["frame_e_3d"]]
            if "affinity" in arrays:
                entry["affinity"] = _affinity(arrays, blobs)
            if {"structure", "true_structure"} <= set(arrays):
                entry["view"] = _view(arrays, n_frames, blobs)
        told[key] = entry
    return told, blobs


def _has_view(run: Tracked, viewed: bool) -> bool:
    return viewed and "e_3d" in run.outcome.metrics


def _words(run: Tracked) -> dict[str, Any]:
    outcome: Outcome = run.outcome
    at = Run.at(run.uri, run.run_id, outcome.key)
    setting = [f"cameras {outcome.cameras}", f"placement {outcome.placement}", f"motion {outcome.motion}"]
    setting = [said for said in setting if not said.endswith(" ")]
    setting.append(f"noise {outcome.level:g}, draw {outcome.repeat}" if outcome.level else "no noise")
    told = {
        "dataset": one_line(outcome.dataset),
        "method": one_line(outcome.method),
        "setting": one_line(", ".join(setting)),
        "status": outcome.status,
        "stand_in": outcome.stand_in,
        "error": one_line(outcome.error, 2000),
        "sizes": {"bodies": outcome.n_bodies, "tracks": outcome.n_points, "frames": outcome.n_frames},
        "metrics": {one_line(name, 60): _short(value) for name, value in sorted(outcome.metrics.items())},
        "seconds": outcome.seconds,
        "peak_mb": outcome.peak_mb,
        "finished": one_line(outcome.finished, 40),
        "parameters": dict(sorted(_flat(outcome.parameters))),
        "versions": {one_line(k, 60): one_line(v) for k, v in outcome.environment.items()},
        "run": at.run_id,
        "link": at.link,
    }
    return {name: value for name, value in told.items() if value not in (None, "", {})}


def _flat(tree: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, str]]:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield one_line(f"{prefix}{name}", 80), one_line(value if isinstance(value, str) else json.dumps(value))


def _view(arrays: Arrays, n_frames: int, blobs: Blobs) -> dict[str, Any]:
    """The frames and points that are shown, coloured by label, wrong tracks named."""
    truth, found = arrays["true_structure"], arrays["structure"]
    n, points = len(truth), truth.shape[2]
    step = -(-n // n_frames)
    shown = np.unique(np.linspace(0, points - 1, min(points, POINTS)).round().astype(int))
    view: dict[str, Any] = {"step": step, "total": n}
    for name, X in (("truth", truth), ("found", arrays.get("alignment", np.eye(3)) @ found)):
        X = X - np.nanmean(X, axis=2, keepdims=True)
        view[name] = blobs.add(X[::step][:, :, shown], "int16")
    true_labels = arrays.get("true_labels")
    if "labels" in arrays:
        labels = matched(arrays["labels"], true_labels)
        view["labels"] = labels[shown].tolist()
        if true_labels is not None:
            view["wrong"] = np.flatnonzero((labels != true_labels)[shown]).tolist()
    if "edges" in arrays and len(shown) == points:
        view["edges"] = arrays["edges"].tolist()
    return view


def _affinity(arrays: Arrays, blobs: Blobs) -> dict[str, Any]:
    A, edges = picture(arrays["affinity"], arrays.get("true_labels"))
    return {"matrix": blobs.add(A, "uint8"), "edges": edges.tolist()}


def _points(steps: NDArray[Any], values: NDArray[Any]) -> dict[str, list[float]]:
    return {"x": [int(step) for step in steps], "y": [_short(value) for value in values]}


def _short(value: float) -> float:
    """Six significant digits."""
    return float(f"{value:.6g}")
