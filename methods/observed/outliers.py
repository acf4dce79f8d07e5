"""Observations that do not fit the motion around them: single outliers, and tracks that jump to another point.

Two images of a rigid scene predict a third, w_f = A w_a + B w_b + c with one A, B (2, 2) and c (2,) for all points,
however the camera turns, shifts and zooms (Ullman, Basri, "Recognition by linear combinations of models", PAMI 1991).
Bodies deform little over a few frames, so it nearly holds for them, too. Each frame is predicted from every pair of its
neighbours. An observation fits if two pairs predict it: an outlier among the neighbours spoils one prediction, and two
outliers agree by chance on one alone.
"""

from __future__ import annotations

from itertools import combinations
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from nrsfm.methods.base import Array, Mask

T = TypeVar("T", bound=np.generic)

#: Frames to either side that a frame is predicted from.
REACH = 3
#: Frames around an observation, of its own track, whose residuals and steps say what is usual.
WINDOW = 25
#: An outlier, or a jump, is off by more than so many usual residuals and so many usual steps from frame to frame.
OUTLIER, JUMP = (8.0, 0.5), (10.0, 2.0)
#: Residuals are never usual below this, in parts of the median distance of points from the middle.
LEAST = 1e-3
#: Rounds of reweighting, of finding single outliers, and of finding jumps.
ROUNDS = 2
#: Pairs of frames, relative to the one that they predict.
PAIRS = tuple(combinations([k for k in range(-REACH, REACH + 1) if k], 2))
#: Share of a pair's line that comes from the frame before, a / (a - b) of positions b and a; all of it, or none.
BEFORE = np.array([1.0 if b < 0 else 0.0 if a > 0 else b / (b - a) for a, b in PAIRS])[:, None, None]


def find_outliers(tracks: Array, visible: Mask | None = None) -> Mask:
    """Which observations of (F, 2, P) tracks are outliers, (F, P); those that are not visible never are.

    Single outliers are found first. Then tracks are cut where what is before and what is after do not predict each
    other. Parts of a few frames are outliers; of the others the longest is kept, the first of two of one length.
    Frames and tracks that would keep fewer than two observations keep all.
    """
    seen: Mask = np.isfinite(tracks[:, 0] + tracks[:, 1]) if visible is None else visible
    X = _even(tracks, seen)
    step = _usual(np.linalg.norm(np.diff(X, axis=0, prepend=X[1:2]), axis=2), seen)
    good: Mask = seen.copy()
    second = second_smallest(distances(X, good, None))
    checked = np.isfinite(second)
    for _ in range(ROUNDS - 1):
        second = second_smallest(distances(X, good, _weights(second, good)))
    for _ in range(ROUNDS):
        second = second_smallest(distances(X, good, _weights(second, good)))
        good &= ~_unusual(second, good, step, OUTLIER)
        good &= np.isfinite(second) | ~checked  # nothing is left that would speak for it
    weights = _weights(second, good)
    for _ in range(ROUNDS):
        parts = np.cumsum(_cuts(distances(X, good, weights), good, step), axis=0, dtype=np.int64)
        cut = np.flatnonzero(parts[-1])
        for p in cut:
            good[:, p] &= (np.bincount(parts[:, p], good[:, p]) > REACH)[parts[:, p]]
        if len(cut) == 0:
            break
    for p in cut:
        good[:, p] &= parts[:, p] == np.argmax(np.bincount(parts[:, p], good[:, p]))
    outliers: Mask = seen & ~good
    outliers[:, good.sum(axis=0) < 2] = False
    outliers[good.sum(axis=1) < 2] = False
    return outliers


def distances(X: Array, good: Mask, weights: Array | None) -> Array:
    """Distance of each observation from its prediction by each pair of :data:`PAIRS`, (pairs, F, P).

    X (F, P, 2) are positions, good (F, P) those that count as neighbours; infinite where one does not. Without weights
    each point is extrapolated along a line. With (F, P) weights, A, B and c of each frame are fitted to what the lines
    leave by weighted least squares, shrunk a little towards the lines; an equation's weight is the product of the
    weights of its three observations.
    """
    F, P, _ = X.shape
    one = np.ones((F, P, 1))
    found = np.empty((len(PAIRS), F, P))
    for k, (a, b) in enumerate(PAIRS):
        A, B = _shifted(X, a), _shifted(X, b)
        R = X - (b * A - a * B) / (b - a)
        if weights is not None:
            Z = np.concatenate([A, B, one], axis=2)
            w = weights * _shifted(weights, a) * _shifted(weights, b)
            weighted = (Z * w[:, :, None]).transpose(0, 2, 1)
            N = weighted @ Z
            size = np.trace(N, axis1=1, axis2=2)[:, None, None] + np.finfo(float).tiny
            R = R - Z @ np.linalg.solve(N + size * np.diag([2e-3, 2e-3, 2e-3, 2e-3, 1e-9]), weighted @ R)
        known = _shifted(good, a) & _shifted(good, b)
        found[k] = np.where(known, np.hypot(R[:, :, 0], R[:, :, 1]), np.inf)
    return found


def second_smallest(D: Array) -> Array:
    """(F, P) from :func:`distances`."""
    return np.asarray(np.partition(D, 1, axis=0)[1])


def _weights(second: Array, good: Mask) -> Array:
    """Weights (F, P) that fall with the second smallest distance, in units of three times the frame's median."""
    r = np.where(good, second, np.inf)
    usual = np.median(r, axis=1, keepdims=True)
    usual = np.where(np.isfinite(usual), np.maximum(usual, LEAST), 1)
    return np.asarray((1 + (r / (3 * usual)) ** 2) ** -2)


def _cuts(D: Array, good: Mask, step: Array) -> Mask:
    """The frames at which a track jumps: neither it nor the good frame before is predicted across, by any pair.

    A prediction from both sides feels its share of a jump; distances are divided by that.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        here = np.where(BEFORE > 0, D / BEFORE, np.inf).min(axis=0)
        there = np.where(BEFORE < 1, D / (1 - BEFORE), np.inf).min(axis=0)
    places = np.arange(len(good))[:, None]
    last = np.roll(np.maximum.accumulate(np.where(good, places, 0), axis=0), 1, axis=0)  # good frame before
    across = np.minimum(here, np.take_along_axis(there, last, axis=0))
    across[0] = 0
    return _unusual(across, good, step, JUMP)


def _even(tracks: Array, seen: Mask) -> Array:
    """(F, P, 2) positions about each frame's median, in units of the median distance from it; 0 where not seen."""
    X = np.where(seen[:, None], tracks, np.nan).transpose(0, 2, 1)
    X = X - np.nanmedian(X, axis=1, keepdims=True)
    sizes = np.nanmedian(np.linalg.norm(X, axis=2), axis=1)
    return np.asarray(np.nan_to_num(X / np.maximum(sizes, np.finfo(float).tiny)[:, None, None]))


def _usual(values: Array, known: Mask) -> Array:
    """Medians of (F, P) values over :data:`WINDOW` frames of their track, unknown ones at the median of all."""
    known = known & np.isfinite(values)
    middle = float(np.median(values[known])) if known.any() else 0.0
    return np.asarray(median_filter(np.where(known, values, middle), size=(WINDOW, 1), mode="mirror"))


def _unusual(values: Array, good: Mask, step: Array, limits: tuple[float, float]) -> Mask:
    """Which finite values of good observations are over the limits."""
    known = good & np.isfinite(values)
    usual = _usual(values, good)
    if known.any():
        usual = np.maximum(usual, max(float(np.median(values[known])), LEAST))
    return np.asarray(known & (values > limits[0] * usual + limits[1] * step))


def _shifted(values: NDArray[T], k: int) -> NDArray[T]:
    """Entry f + k at place f along the first axis; zeros beyond the ends."""
    shifted: NDArray[T] = np.zeros_like(values)
    if abs(k) < len(values):
        here = slice(max(0, -k), len(values) - max(0, k))
        there = slice(max(0, k), len(values) + min(0, k))
        shifted[here] = values[there]
    return shifted
