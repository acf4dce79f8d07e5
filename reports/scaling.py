"""How the solver scales: time and memory against the number of tracks and frames, with the operation count beside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.figures import COLOURS, GREY

DENSE = 5 / 3  # P^3 operations of the dense iteration's factors and symmetric product


@dataclass(frozen=True)
class Measured:
    """One trial: its size, and what an iteration took once the code had filled.

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
    """A trial by its curves."""
    late = slice(len(seconds) // 2, None)
    return Measured(n_points, n_frames, float(np.median(seconds[late])), float(np.median(operations[late])), peak_mb)


def scaling(trials: Sequence[Measured]) -> Figure:
    """CPU seconds, counted operations and peak memory an iteration, against P for each F; double logarithmic.

    The dense iteration's operations, and a dense P x P array, stand beside for comparison.
    """
    figure = Figure(figsize=(13, 4.2), layout="constrained")
    row = figure.subplots(1, 3)
    lengths = sorted({trial.n_frames for trial in trials})
    for colour, F in zip(COLOURS, lengths, strict=False):
        mine = sorted((t for t in trials if t.n_frames == F), key=lambda t: t.n_points)
        P = np.array([t.n_points for t in mine])
        for axes, name in zip(row, ("seconds", "operations", "peak_mb"), strict=True):
            values = np.array([getattr(t, name) for t in mine])
            label = f"F = {F}" + (f", P^{_slope(P, values):.2f}" if name != "peak_mb" and len(P) > 2 else "")
            axes.loglog(P, values, "o-", color=colour, markersize=4, label=label)
    P = np.array(sorted({t.n_points for t in trials}), dtype=float)
    row[1].loglog(P, DENSE * P**3, "--", color=GREY, label="dense, 5/3 P^3")
    row[2].loglog(P, 8 * P**2 / 2**20, "--", color=GREY, label="one dense P x P array")
    for axes, title in zip(
        row, ("CPU seconds an iteration", "operations an iteration", "peak memory, MB"), strict=True
    ):
        _dress(axes, title)
    return figure


def _slope(P: np.ndarray, values: np.ndarray) -> float:
    """The exponent over the upper half of the sizes."""
    half = slice(len(P) // 2 - (len(P) < 4), None)
    return float(np.polyfit(np.log(P[half]), np.log(values[half]), 1)[0])


def _dress(axes: Axes, title: str) -> None:
    axes.set(title=title, xlabel="tracks P")
    axes.grid(which="major", color="#dddddd", linewidth=0.6)
    axes.legend(frameon=False, fontsize=8)
