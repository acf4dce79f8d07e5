"""The runs behind the cells as data of the report's page: settings, numbers, curves and 3D views.

Positions are stored as 16-bit integers; an array that several runs share (the truth of a scene, a structure of two
pipelines) is stored once.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from nrsfm.harness.evaluate.matching import matched
from nrsfm.harness.record.parameters import flatten
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.tracked import Arrays, Fetch, Tracked
from nrsfm.reports.figures.page_data import Blobs, significant
from nrsfm.reports.page.view3d import plot_data, view_data
from nrsfm.reports.tables.model import Run

BUDGET = 6 << 20  # bytes of positions in a page, before base64

FRAMES, POINTS = 100, 1000  # the most that a 3D view shows, evenly taken


def details(runs: Iterable[Tracked], fetch: Fetch, viewed: Iterable[str]) -> tuple[dict[str, Any], Blobs]:
    """All data of each run, by trial key, and the arrays that they name.

    The arrays of ``viewed`` runs are shown: curves, affinity, and a 3D view where the truth is known.
    """
    by_key, views = {run.outcome.key: run for run in runs}, set(viewed)
    with_view = [run for key, run in by_key.items() if key in views and "e_3d" in run.outcome.metrics]
    bytes_a_frame = sum(12 * min(run.outcome.n_points or 0, POINTS) for run in with_view)  # truth and estimate
    n_frames = int(np.clip(BUDGET // max(bytes_a_frame, 1), 8, FRAMES))
    blobs, data = Blobs(), {}
    for key, run in by_key.items():
        arrays = fetch(run) if key in views else {}
        data[key] = _facts(run) | (_plots(arrays, n_frames, blobs) if arrays else {})
    return data, blobs


def _facts(run: Tracked) -> dict[str, Any]:
    """Settings and numbers of a run; what is empty is left out."""
    outcome = run.outcome
    at = Run.at(run.uri, run.run_id, outcome.key)
    setting = [f"{name} {value}" for name in ("cameras", "placement", "motion") if (value := getattr(outcome, name))]
    setting.append(f"noise {outcome.level:g}, draw {outcome.repeat}" if outcome.level else "no noise")
    parameters = {
        one_line(name, 80): one_line(value if isinstance(value, str) else json.dumps(value))
        for name, value in flatten(outcome.parameters).items()
    }
    facts = {
        "dataset": one_line(outcome.dataset),
        "method": one_line(outcome.method),
        "setting": one_line(", ".join(setting)),
        "status": outcome.status,
        "stand_in": outcome.stand_in,
        "error": one_line(outcome.error, 2000),
        "sizes": {"bodies": outcome.n_bodies, "tracks": outcome.n_points, "frames": outcome.n_frames},
        "metrics": {one_line(name, 60): significant(value) for name, value in sorted(outcome.metrics.items())},
        "seconds": outcome.seconds,
        "peak_mb": outcome.peak_mb,
        "finished": one_line(outcome.finished, 40),
        "parameters": dict(sorted(parameters.items())),
        "versions": {one_line(k, 60): one_line(v) for k, v in outcome.environment.items()},
        "run": at.run_id,
        "link": at.link,
    }
    return {name: value for name, value in facts.items() if value not in (None, "", {})}


def _plots(arrays: Arrays, n_frames: int, blobs: Blobs) -> dict[str, Any]:
    truth = arrays.get("true_labels")
    data = plot_data(blobs, arrays, arrays.get("frame_e_3d"), arrays.get("affinity"), truth)
    if {"structure", "true_structure"} <= set(arrays):
        labels = matched(arrays["labels"], truth) if "labels" in arrays else None
        data["view"] = view_data(
            blobs,
            arrays.get("alignment", np.eye(3)) @ arrays["structure"],
            arrays["true_structure"],
            labels,
            None if labels is None or truth is None else labels != truth,
            arrays.get("edges"),
            frames=n_frames,
            points=POINTS,
        )
    return data
