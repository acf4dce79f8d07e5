"""The plots of one run as the data of a page: the 3D view, the curves and the affinity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.harness.record.curves import thinned
from nrsfm.reports.figures.affinity import picture
from nrsfm.reports.figures.page_data import Blobs, evenly, rounded


def view_data(
    blobs: Blobs,
    structure: NDArray[Any],
    truth: NDArray[Any] | None,
    labels: NDArray[Any] | None,
    wrong: NDArray[np.bool_] | None,
    edges: NDArray[Any] | None,
    *,
    frames: int,
    points: int,
) -> dict[str, Any]:
    """Positions, labels (P,), wrong tracks (P,) and edges (E, 2) of at most so many frames and points, evenly taken.

    Structure and truth are (F, 3, P), in the same axes. Edges are left out where points are.
    """
    F, _, P = structure.shape
    step, shown = -(-F // frames), evenly(P, points)
    data: dict[str, Any] = {"step": step, "total": F}
    for name, X in (("found", structure), ("truth", truth)):
        if X is not None:
            X = X - np.nanmean(X, axis=2, keepdims=True)
            data[name] = blobs.add(X[::step][:, :, shown], "int16")
    if labels is not None:
        data["labels"] = labels[shown].tolist()
    if wrong is not None:
        data["wrong"] = np.flatnonzero(wrong[shown]).tolist()
    if edges is not None and len(shown) == P:
        data["edges"] = edges.tolist()
    return data


def plot_data(
    blobs: Blobs,
    history: Mapping[str, NDArray[Any]],
    errors: NDArray[Any] | None,
    affinity: Any,
    truth: NDArray[Any] | None,
) -> dict[str, Any]:
    """Curves by iteration, errors (F,) by frame, and the affinity (P, P), its tracks sorted by ``truth`` (P,).

    ``history_NAME`` holds a value for each iteration; other arrays are ignored.
    """
    curves = thinned(history).items()
    data: dict[str, Any] = {
        "curves": {name: {"x": steps.tolist(), "y": rounded(values.tolist())} for name, (steps, values) in curves}
    }
    if errors is not None:
        data["frames"] = rounded(errors.tolist())
    if affinity is not None:
        matrix, edges = picture(affinity, truth)
        data["affinity"] = {"matrix": blobs.add(matrix, "uint8"), "edges": edges.tolist()}
    return data
