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
    """Positions, labels, wrong tracks and edges of at most so many frames and points, evenly taken.

    Parameters
    ----------
    blobs : Blobs
        Takes the positions.
    structure, truth : (F, 3, P) array
        In the same axes; the truth may be None.
    labels, wrong : (P,) array or None
    edges : (E, 2) array or None
        Left out where points are.
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
    """Curves by iteration, errors by frame, and the affinity with its tracks sorted by the labels ``truth``.

    Parameters
    ----------
    history : mapping
        ``history_NAME`` -> a value for each iteration, among other arrays.
    errors : (F,) array or None
    affinity : (P, P) array, sparse array or None
    truth : (P,) array or None
    """
    data: dict[str, Any] = {
        "curves": {
            name: {"x": steps.tolist(), "y": rounded(values.tolist())}
            for name, (steps, values) in thinned(history).items()
        }
    }
    if errors is not None:
        data["frames"] = rounded(errors.tolist())
    if affinity is not None:
        matrix, edges = picture(affinity, truth)
        data["affinity"] = {"matrix": blobs.add(matrix, "uint8"), "edges": edges.tolist()}
    return data
