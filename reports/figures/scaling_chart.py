"""Time, operations and memory of the solver against the number of tracks and frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from nrsfm.harness.record.tracked import Fetch, Tracked
from nrsfm.reports.figures.chart import Panel, Series

COSTS = ("seconds", "operations")  # of each iteration, in a trial's arrays
DENSE = 5 / 3  # P^3 operations of the dense iteration's factors and symmetric product


def scaling(runs: Sequence[Tracked], fetch: Fetch) -> Iterator[Panel]:
    """CPU seconds, counted operations and peak memory an iteration, against P for each F; double logarithmic.

    Seconds (of all cores) and operations are the medians over the second half of the iterations. For comparison: the
    operations of a dense iteration, and a dense P x P array.
    """
    trials = pd.DataFrame(
        {name: np.median(arrays[f"history_{name}"][len(arrays[f"history_{name}"]) // 2 :]) for name in COSTS}
        | {"P": float(run.outcome.n_points or 0), "F": run.outcome.n_frames or 0, "peak_mb": run.outcome.peak_mb or 0.0}
        for run in runs
        if {f"history_{name}" for name in COSTS} <= (arrays := fetch(run)).keys()
    )
    if trials.empty:
        return
    every = np.unique(trials["P"])
    beside = {
        "operations": ("dense, 5/3 P^3", DENSE * every**3),
        "peak_mb": ("one dense P x P array", 8 * every**2 / 2**20),
    }
    titles = {"seconds": "CPU seconds an iteration", "operations": "operations an iteration", "peak_mb": "peak memory"}
    groups = trials.sort_values("P", kind="stable").groupby("F")
    for name, title in titles.items():
        series, slopes = [], []
        for place, (F, group) in enumerate(groups):
            P, values = group["P"].to_numpy(), group[name].to_numpy()
            series.append(Series(f"F = {F}", tuple(P), tuple(values), (), place))
            if len(P) > 2 and name != "peak_mb":
                slopes.append(f"P^{_slope(P, values):.2f}")
        if name in beside:
            label, values = beside[name]
            series.append(Series(label, tuple(every), tuple(values), (), len(groups) + list(beside).index(name)))
        title = f"{title}: {', '.join(slopes)}" if slopes else title
        yield Panel(title, "tracks P", "MB" if name == "peak_mb" else "", tuple(series), log_x=True, log_y=True)


def _slope(P: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """The exponent over the upper half of the sizes."""
    half = slice(len(P) // 2 - (len(P) < 4), None)
    return float(np.polyfit(np.log(P[half]), np.log(values[half]), 1)[0])
