"""What trackers and zooming cameras do to tracks, reproducible from the scene: outliers, jumps, a scale per frame."""

from __future__ import annotations

import numpy as np

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError, is_number
from nrsfm.datasets.noise import seed

ZOOMS = ("smooth", "random")


def corrupt(
    tracks: Array,
    scene: str,
    *,
    outliers: float = 0.0,
    jumps: float = 0.0,
    zoom: float = 0.0,
    zooming: str = "smooth",
    repeat: int = 0,
) -> Array:
    """A corrupted copy of (F, 2, P) tracks; positions that are NaN stay NaN, and no others are.

    Each draw depends on the scene's name, amount and repeat.

    Parameters
    ----------
    outliers : float
        Share of the observations that go anywhere in the rectangle around all tracks, uniformly.
    jumps : float
        Share of the tracks that jump to another track, at any time of the third quarter, and stay on it.
    zoom : float
        Each frame is scaled by a factor from 1 - zoom to 1 + zoom, over the geometric mean of all factors. ``smooth``
        is one period of a sine over the sequence, ``random`` is drawn for each frame.

    Raises
    ------
    DatasetError
        If a setting is out of range.
    """
    for name, value in (("outliers", outliers), ("jumps", jumps), ("zoom", zoom)):
        if not is_number(value) or not 0 <= value < 1:
            raise DatasetError(f"corruption.{name} is {value!r}, wanted a number from 0 to less than 1")
    if zooming not in ZOOMS:
        raise DatasetError(f"corruption.zooming is {zooming!r}, wanted one of {', '.join(ZOOMS)}")
    F, _, P = tracks.shape
    W = tracks.copy()
    if jumps:
        rng = np.random.default_rng(seed(f"{scene}|jumps", jumps, repeat))
        for p in rng.permutation(P)[: round(jumps * P)]:
            start, target = rng.integers(F // 2, max(3 * F // 4, F // 2 + 1)), (p + rng.integers(1, P)) % P
            mine, other = tracks[start:, :, p], tracks[start:, :, target]
            W[start:, :, p] = np.where(np.isnan(mine + other), mine, other)
    if zoom:
        W *= zoom_factors(F, zoom, zooming, seed(f"{scene}|{zooming} zoom", zoom, repeat))[:, None, None]
    if outliers:
        rng = np.random.default_rng(seed(f"{scene}|outliers", outliers, repeat))
        seen = np.argwhere(np.isfinite(W[:, 0]))
        f, p = rng.permutation(seen)[: round(outliers * len(seen))].T
        W[f, :, p] = rng.uniform(np.nanmin(W, axis=(0, 2)), np.nanmax(W, axis=(0, 2)), (len(f), 2))
    return W


def zoom_factors(n_frames: int, zoom: float, zooming: str, seed: int) -> Array:
    """(F,) factors of geometric mean 1; see :func:`corrupt`."""
    rng = np.random.default_rng(seed)
    if zooming == "random":
        factors = 1 + rng.uniform(-zoom, zoom, n_frames)
    else:
        factors = 1 + zoom * np.sin(2 * np.pi * (np.arange(n_frames) / n_frames + rng.uniform()))
    normalised: Array = factors / np.exp(np.log(factors).mean())
    return normalised
