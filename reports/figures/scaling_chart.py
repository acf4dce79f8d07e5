"""Time, operations and memory of the solver against the number of tracks and frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrsfm.reports.figures.chart import Panel, Series

DENSE = 5 / 3  # P^3 operations of the dense iteration's factors and symmetric product


@dataclass(frozen=True)
class Measured:
    """One trial: its size, and the cost of its late iterations.

    Parameters
    ----------
    n_points, n_frames : int
    seconds : float
        Of all cores, the median iteration of the second half.
    operations : float
        Counted, of the same iterations.
    peak_mb : float
        Largest resident size of the trial's process.
    """

    n_points: int
    n_frames: int
    seconds: float
    operations: float
    peak_mb: float


def measured(
    n_points: int, n_frames: int, seconds: Sequence[float], operations: Sequence[float], peak_mb: float
) -> Measured:
    """A trial from its curves by iteration."""
    late = slice(len(seconds) // 2, None)
    return Measured(n_points, n_frames, float(np.median(seconds[late])), float(np.median(operations[late])), peak_mb)


def scaling(trials: Sequence[Measured]) -> Iterator[Panel]:
    """CPU seconds, counted operations and peak memory an iteration, against P for each F; double logarithmic.

    For comparison: the operations of a dense iteration, and a dense P x P array.
    """
    if not trials:
        return
    lengths = sorted({trial.n_frames for trial in trials})
    every = np.array(sorted({t.n_points for t in trials}), dtype=float)
    beside = {
        "operations": ("dense, 5/3 P^3", DENSE * every**3),
        "peak_mb": ("one dense P x P array", 8 * every**2 / 2**20),
    }
    titles = {"seconds": "CPU seconds an iteration", "operations": "operations an iteration", "peak_mb": "peak memory"}
    for name, title in titles.items():
        series, slopes = [], []
        for place, F in enumerate(lengths):
            group = sorted((t for t in trials if t.n_frames == F), key=lambda t: t.n_points)
            P, values = (np.array([getattr(t, of) for t in group], float) for of in ("n_points", name))
            series.append(Series(f"F = {F}", tuple(P), tuple(values), (), place))
            if len(P) > 2 and name != "peak_mb":
                slopes.append(f"P^{_slope(P, values):.2f}")
        if name in beside:
            label, values = beside[name]
            series.append(Series(label, tuple(every), tuple(values), (), len(lengths) + list(beside).index(name)))
        title = f"{title}: {', '.join(slopes)}" if slopes else title
        yield Panel(title, "tracks P", "MB" if name == "peak_mb" else "", tuple(series), log_x=True, log_y=True)


def _slope(P: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """The exponent over the upper half of the sizes."""
    half = slice(len(P) // 2 - (len(P) < 4), None)
    return float(np.polyfit(np.log(P[half]), np.log(values[half]), 1)[0])
