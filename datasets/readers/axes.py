"""Which axis of an array of tracks is time.

Axes are written with the letters F (frames), P (tracks) and 2 (x, y), and a comma between the axes of the array. Of two
letters on one axis the second runs faster: ``F2,P`` has the rows x, y of the first frame, then those of the second;
``2F,P`` has all rows of x, then all of y; ``P,F2`` is ``F2,P`` transposed; ``F,P,2`` is an array (F, P, 2).

A track moves little from a frame to the next, compared with the difference between its x and its y once both are
centred. In a wrong order either neighbours in "time" are other tracks, or "x" and "y" are neighbours in time. Hence the
order with the least ratio of the two (:func:`roughness`).

Of 173 scenes (the mocap pairs, Hopkins155, a surface of 1500 points, two boxes), ``F2,P`` is read right in all where it
is documented. Of ``2F,P``, ``P,F2``, ``F,P,2`` and ``P,F,2`` 171, 169, 172 and 172 are read right, and the rest is
refused. How x and y alternate within a frame that is one row (``F,P2`` or ``F,2P``) cannot be seen in the numbers.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError

DECISIVE = 3.0  # by how much smoother an order must be to be taken
SAMPLE = 200  # frames and tracks that are looked at


def orders(shape: Sequence[int]) -> list[str]:
    """All orders that an array of two or three axes may have."""
    letters = list(permutations("F2P"))
    texts = [f"{a},{b},{c}" for a, b, c in letters]
    if len(shape) == 2:
        texts = [text for a, b, c in letters for text in (f"{a}{b},{c}", f"{a},{b}{c}")]
    return [text for text in texts if all(map(_fits, text.split(","), shape))]


def _fits(word: str, size: int) -> bool:
    """Whether an axis of that size may hold what the letters say."""
    if len(word) == 2:
        return "2" in word and size % 2 == 0
    return word != "2" or size == 2


def arranged(array: NDArray[Any], axes: str) -> NDArray[Any]:
    """An array as (F, 2, P)."""
    sizes: list[int] = []
    for word, size in zip(axes.split(","), array.shape, strict=True):
        sizes += [2 if letter == "2" else size // (2 if len(word) == 2 else 1) for letter in word]
    letters = axes.replace(",", "")
    return array.reshape(sizes).transpose([letters.index(letter) for letter in "F2P"])


def roughness(tracks: NDArray[Any]) -> float:
    """Step of (F, 2, P) tracks between frames, relative to the distance of centred x and y; both medians.

    Half way through the frames the step is looked at on its own: if blocks of x and y are taken for frames, it is large
    there alone. So is the distance from the last x to the first y: if halves of the frames are taken for x and y, it is
    small there alone.
    """
    F, _, P = tracks.shape
    if F < 2 or not P:
        return np.inf
    f, p = (np.unique(np.linspace(0, n - 1, SAMPLE).astype(int)) for n in (F - 1, P))
    first, second, before, middle = (
        np.asarray(tracks[g][:, :, p], dtype=float) for g in (f, f + 1, [F // 2 - 1], [F // 2])
    )
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        X = first - _median(first, axis=(0, 2))
        step = np.fmax(_median(np.abs(second - first)), _median(np.abs(middle - before)))
        joint = _median(np.abs(np.asarray(tracks[0, 1, p], dtype=float) - np.asarray(tracks[-1, 0, p], dtype=float)))
        return float(np.nan_to_num(step / np.fmin(_median(np.abs(X[:, 0] - X[:, 1])), joint), nan=np.inf))


def _median(values: Array, axis: tuple[int, ...] | None = None) -> Array:
    """Median of the finite values; NaN where there is none."""
    with warnings.catch_warnings(action="ignore"):  # of slices that are NaN throughout
        return np.asarray(np.nanmedian(np.where(np.isfinite(values), values, np.nan), axis, keepdims=axis is not None))


def recognise(path: Path, name: str, array: NDArray[Any], documented: str, asked: str) -> tuple[str, str]:
    """The order of an array's axes, and a note if it is not the documented one.

    Parameters
    ----------
    documented : str
        The order that the file's layout has; empty if it is not known.
    asked : str
        The order that the user gives; empty for none.

    Raises
    ------
    DatasetError
        If the shape allows no order, or several, and the numbers do not decide between them.
    """
    allowed = orders(array.shape) if array.ndim in (2, 3) else []
    if asked:
        if asked not in allowed:
            raise DatasetError(f"{path}: {name} has shape {array.shape}, which --axes {asked!a:.20} does not fit")
        return asked, ""
    if not allowed:
        return "", ""
    if allowed == [documented]:
        return documented, ""
    ratios = {axes: roughness(arranged(array, axes)) for axes in allowed}
    best = min(ratios, key=ratios.__getitem__)
    if documented in ratios and not DECISIVE * ratios[best] < ratios[documented]:
        return documented, ""
    likely = [axes for axes in allowed if not DECISIVE * ratios[best] < ratios[axes]]
    if len(likely) > 1:
        raise DatasetError(
            f"{path}: {name} has shape {array.shape}, and its numbers do not say which axis is time; say it with "
            f"--axes, one of {' '.join(likely)} (F frames, P tracks, 2 x and y)"
        )
    return best, f"{name} {array.shape} was read with the axes {best} (F frames, P tracks, 2 x and y), as it is smooth"
