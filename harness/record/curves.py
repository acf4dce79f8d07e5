"""The curves that an iterative method leaves: objective and residuals by iteration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEPS = 100
"""Points of a curve that go to the tracker and to reports; all of them are in a trial's arrays."""


COSTS = frozenset({"history_seconds", "history_operations"})
"""What an iteration took: in a trial's arrays, and no residual."""


def thinned(arrays: Mapping[str, NDArray[Any]]) -> dict[str, tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """Iterations (from 1) and values of each ``history_*`` array, thinned evenly, first and last kept.

    Returns
    -------
    dict
        ``objective``, and ``residual_NAME`` for each residual, to the finite points that are kept.
    """
    found = {}
    for name in sorted(n for n in arrays if n.startswith("history_") and n not in COSTS):
        values = arrays[name]
        steps = np.unique(np.linspace(0, len(values) - 1, min(STEPS, len(values))).round().astype(int))
        steps = steps[np.isfinite(values[steps])]
        label = name.removeprefix("history_")
        found[label if label == "objective" else f"residual_{label}"] = (steps + 1, values[steps])
    return found
