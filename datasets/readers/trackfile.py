"""What every reader of tracks returns, and the checks that they share."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError, is_number

MOST = 20_000_000  # positions of a file
LONGEST = 1_000_000  # frames, and tracks
DIGITS = re.compile(r"(?<=:)\d+\.\d+|\d+")  # behind a colon stand seconds, which may have decimals


@dataclass(frozen=True)
class TrackFile:
    """Contents of a file of tracks, before they are checked against each other."""

    tracks: Array  # (F, 2, P), NaN where a track is not observed
    frames: tuple[str, ...]  # names in the file
    ids: tuple[str, ...]  # of the tracks, in the file
    cameras: Array | None = None  # (F, 2, 3)
    structure: Array | None = None  # (F, 3, P)
    labels: NDArray[np.int64] | None = None  # (P,)
    bodies: tuple[str, ...] = ()  # names of the labels in the file
    notes: tuple[str, ...] = ()  # how the file was read, where its user may have meant otherwise
    image: bool = False  # its layout is one of images, where y points down


#: What ``columns`` may give a name for: columns of a table, fields of an array file.
COLUMNS = ("frame", "track", "x", "y", "label", "visible", "confidence")
ROLES = (*COLUMNS, "tracks", "occluded", "cameras", "structure", "labels")
Y = ("auto", "down", "up")


@dataclass(frozen=True)
class Asked:
    """How a user says that a file is to be read.

    Parameters
    ----------
    columns : mapping
        The names in the file for some of :data:`ROLES`.
    axes : str
        What the axes of the array of tracks are, see :mod:`nrsfm.datasets.readers.axes`; empty to have it recognised.
    confidence : float or None
        Confidence below which a position counts as not observed; None takes the layout's own.
    y : {"auto", "down", "up"}
        Where y points in the image. ``auto``: downwards if the layout is one of images, or hardly any coordinate is
        negative.

    Raises
    ------
    DatasetError
        If one of them cannot be used.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    axes: str = ""
    confidence: float | None = None
    y: str = "auto"

    def __post_init__(self) -> None:
        words = self.columns.items() if isinstance(self.columns, Mapping) else [(self.columns, None)]
        if odd := next((role for role, name in words if role not in ROLES or not isinstance(name, str)), None):
            raise DatasetError(
                f"columns gives {str(odd)[:40]!a} a name, wanted NAME=COLUMN for some of {', '.join(ROLES)}"
            )
        if not isinstance(self.axes, str):
            raise DatasetError(f"axes is {str(self.axes)[:40]!a}, wanted letters such as F,P,2")
        if self.confidence is not None and not is_number(self.confidence):
            raise DatasetError(f"confidence is {str(self.confidence)[:40]!a}, wanted a number")
        if self.y not in Y:
            raise DatasetError(f"y is {str(self.y)[:40]!a}, wanted one of {', '.join(Y)}")


RECOGNISED = Asked()  # nothing is said


def check_size(path: Path, n_frames: int, n_points: int) -> None:
    """Raise DatasetError if a file has more than :data:`MOST` positions, or :data:`LONGEST` frames or tracks."""
    if n_frames * n_points > MOST or max(n_frames, n_points) > LONGEST:
        raise DatasetError(
            f"{path}: it holds {n_frames} frames of {n_points} tracks, more than {MOST} positions or {LONGEST} frames "
            "or tracks; leave some out"
        )


def unused(word: str, names: Sequence[str]) -> tuple[str, ...]:
    """The note that names what a file holds and is not used; none if there is nothing."""
    if not names:
        return ()
    shown = ", ".join(ascii(name[:40])[1:-1] or "''" for name in names[:8]) + (", ..." if len(names) > 8 else "")
    return (f"not used: {word}{'' if len(names) == 1 else 's'} {shown}",)


def named(path: Path, field: str, words: list[str]) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Indices (n,) of words in the sorted list of different words, and that list; numbers are sorted by value.

    Raises DatasetError if a word is empty, long or not printable.
    """
    once = sorted(set(words), key=order)
    check_words(path, field, once)
    place = {word: k for k, word in enumerate(once)}
    return np.array([place[word] for word in words], dtype=np.int64), tuple(once)


def order(word: str) -> tuple[bool, float, str]:
    """Sort key of a word: numbers by value, before other words."""
    try:
        value = float(word)
    except ValueError:
        return True, 0.0, word
    return (False, value, word) if abs(value) < float("inf") else (True, 0.0, word)


def in_order(path: Path, field: str, names: Sequence[str]) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Names of frames or tracks in their order, and the place of each of ``names`` in it.

    Numbers are sorted by value. Names that differ in numbers alone (``img_2.png``, ``00:01:59.5``) are sorted by these.
    Tracks of other names stay as they are.

    Raises
    ------
    DatasetError
        If a name is empty, long or not printable, or the order of frames is not known.
    """
    check_words(path, field, names)
    places, keys = list(range(len(names))), [order(name) for name in names]
    if not any(is_word for is_word, _, _ in keys):
        places.sort(key=keys.__getitem__)
    else:
        between = [DIGITS.sub("0", name) for name in names]
        other = next((k for k, text in enumerate(between) if text != between[0]), None)
        if other is None:
            numbers = [[float(number) for number in DIGITS.findall(name)] for name in names]
            places.sort(key=numbers.__getitem__)
        elif field == "frame":
            raise DatasetError(
                f"{path}: which of the frames {names[0][:40]!a} and {names[other][:40]!a} comes first is not known; "
                "number the frames"
            )
    return tuple(names[k] for k in places), np.argsort(places)


def check_words(path: Path, field: str, words: Sequence[str]) -> None:
    """Raise DatasetError unless names have 1 to 100 printable characters."""
    odd = next((word for word in words if not (0 < len(word) <= 100 and word.isprintable())), None)
    if odd is not None:
        raise DatasetError(f"{path}: {field} {odd[:40]!a} is not a name, wanted 1 to 100 printable characters")
