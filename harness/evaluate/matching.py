"""Which cluster is which body."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment


def matched(labels: NDArray[Any], truth: NDArray[Any] | None) -> NDArray[Any]:
    """Clusters (P,) renamed after the bodies that they match best, so that colours mean bodies.

    Clusters beyond the bodies take the next free names; without the truth nothing is renamed.
    """
    if truth is None:
        return labels
    found, bodies = np.unique(labels), np.unique(truth)
    overlap = np.array([[((labels == a) & (truth == b)).sum() for b in bodies] for a in found])
    rows, columns = linear_sum_assignment(-overlap)
    names = {found[r]: bodies[c] for r, c in zip(rows, columns, strict=True)}
    for spare, label in enumerate((label for label in found if label not in names), start=int(bodies.max()) + 1):
        names[label] = spare
    return np.array([names[label] for label in labels])


def called(body: str) -> str:
    """A body's name for readers: ``label 2`` where it is a mere number."""
    return f"label {body}" if body.lstrip("-").isdigit() else body
