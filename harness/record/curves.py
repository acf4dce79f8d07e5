"""Curves of an iterative method: objective and residuals by iteration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEPS = 100
"""Points of a curve in the tracker and in reports; a trial's arrays hold all of them."""

COSTS = frozenset({"history_seconds", "history_operations"})
"""Arrays with the cost of each iteration, which are not residuals."""


def thinned(arrays: Mapping[str, NDArray[Any]]) -> dict[str, tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """Iterations (from 1) and values of each ``history_*`` array, thinned evenly.

    The first and last are kept, and what is not finite is left out. The names are ``objective`` and ``residual_NAME``.
    """
    curves = {}
    for name in sorted(n for n in arrays if n.startswith("history_") and n not in COSTS):
        values = arrays[name]
        steps = np.unique(np.linspace(0, len(values) - 1, min(STEPS, len(values))).round().astype(int))
        steps = steps[np.isfinite(values[steps])]
        label = name.removeprefix("history_")
        curves[label if label == "objective" else f"residual_{label}"] = (steps + 1, values[steps])
    return curves
