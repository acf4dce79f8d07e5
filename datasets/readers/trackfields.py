"""Tracks, cameras, structure and labels in the fields of .npz and MATLAB files, by their usual names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.datasets.readers.npzfile import read_npz

#: The names that a field may have.
NAMES: Mapping[str, tuple[str, ...]] = {
    "tracks": ("tracks", "W"),
    "visible": ("visible",),
    "cameras": ("cameras", "R", "Rs"),
    "structure": ("structure", "S"),
    "labels": ("labels", "s"),
}

MOST = 20_000_000  # positions of a file
LONGEST = 1_000_000  # frames, and tracks
SAVE = "save them as 'tracks' (F, 2, P), or as 'W' (2F, P) with rows x, y for each frame; NaN is not observed"


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


def read_fields(path: Path) -> TrackFile:
    """Read an .npz or .mat file.

    ``tracks`` or ``W`` is (F, 2, P), or (2F, P) with rows x, y for each frame; so are ``cameras``, ``R`` or ``Rs``,
    (F, 2, 3) or (2F, 3), and ``structure`` or ``S``, (F, 3, P) or (3F, P). ``labels`` or ``s`` is (P,), (P, 1) or
    (1, P), ``visible`` (F, P) of 0 and 1. All but the tracks may be absent. Frames and tracks are named by their
    index, from 0 on.

    Raises
    ------
    DatasetError
        If the file cannot be read, or a field is there under two names, is not numeric or has another shape.
    """
    every = [name for names in NAMES.values() for name in names]
    stored: Mapping[str, NDArray[Any]]
    stored = read_npz(path, every) if path.suffix.lower() == ".npz" else read_mat(path, [], every)
    fields = {field: (name, stored[name]) for field in NAMES if (name := _name_of(path, field, stored))}
    if "tracks" not in fields:
        raise DatasetError(f"{path}: it holds no tracks; {SAVE}")
    W = _frames(path, *fields["tracks"], rows=2, columns=None)
    F, _, P = W.shape
    if "visible" in fields:
        W = _hide(path, *fields["visible"], W)
    labels, bodies = _labels(path, *fields["labels"], P) if "labels" in fields else (None, ())
    frames, ids = (tuple(map(str, range(n))) for n in (F, P))
    more = {
        field: _frames(path, *fields[field], rows=rows, columns=columns, frames=F)
        for field, rows, columns in (("cameras", 2, 3), ("structure", 3, P))
        if field in fields
    }
    return TrackFile(W, frames, ids, labels=labels, bodies=bodies, **more)


def _name_of(path: Path, field: str, stored: Mapping[str, Any]) -> str:
    """The name under which a field is there, "" for none."""
    names = [name for name in NAMES[field] if name in stored]
    if len(names) > 1:
        raise DatasetError(f"{path}: it holds {field} twice, as {' and '.join(names)}; leave one of them out")
    return names[0] if names else ""


def _numbers(path: Path, name: str, value: NDArray[Any], kinds: str = "fiu") -> NDArray[Any]:
    """The value; DatasetError unless its dtype is of one of the kinds."""
    if value.dtype.kind not in kinds:
        raise DatasetError(f"{path}: field {name} is of type {value.dtype}, wanted numbers")
    return value


def _frames(
    path: Path, name: str, value: NDArray[Any], *, rows: int, columns: int | None, frames: int | None = None
) -> Array:
    """An array (F, rows, columns), from one of that shape or from (rows F, columns); None allows any number."""
    value, shape = _numbers(path, name, value), value.shape
    if value.ndim == 2 and value.shape[0] % rows == 0:
        value = value.reshape(value.shape[0] // rows, rows, value.shape[1])
    sizes = [("F" if frames is None else frames), rows, ("P" if columns is None else columns)]
    fits = value.ndim == 3 and all(
        isinstance(want, str) or got == want for want, got in zip(sizes, value.shape, strict=True)
    )
    if not fits:
        stacked = f"{rows}F" if frames is None else rows * frames
        wanted = f"({', '.join(map(str, sizes))}) or ({stacked}, {sizes[2]})"
        remedy = SAVE if name in NAMES["tracks"] else "bring it to the tracks' frames, or leave it out"
        raise DatasetError(f"{path}: field {name} has shape {shape}, wanted {wanted}; {remedy}")
    if rows == 2 and columns is None:
        check_size(path, value.shape[0], value.shape[2])
    return np.array(value, dtype=float)


def check_size(path: Path, n_frames: int, n_points: int) -> None:
    """Raise DatasetError if a file has more than :data:`MOST` positions, or :data:`LONGEST` frames or tracks."""
    if n_frames * n_points > MOST or max(n_frames, n_points) > LONGEST:
        raise DatasetError(
            f"{path}: it holds {n_frames} frames of {n_points} tracks, more than {MOST} positions or {LONGEST} frames "
            "or tracks; leave some out"
        )


def _hide(path: Path, name: str, value: NDArray[Any], W: Array) -> Array:
    """The tracks with NaN where ``visible`` is 0."""
    F, _, P = W.shape
    value = _numbers(path, name, value, "fiub")
    if value.shape != (F, P):
        raise DatasetError(f"{path}: field {name} has shape {value.shape}, wanted {(F, P)}; NaN in the tracks does too")
    if not ((value == 0) | (value == 1)).all():
        raise DatasetError(f"{path}: field {name} holds other numbers than 0 and 1; write 1 where a track is observed")
    lacking = (value == 1) & np.isnan(W).any(axis=1)
    if lacking.any():
        frame, track = np.argwhere(lacking)[0]
        raise DatasetError(
            f"{path}: frame {frame}, track {track} is NaN in the tracks and 1 in {name}; write 0 there, or leave "
            f"{name} out"
        )
    return np.where((value == 1)[:, None], W, np.nan)


def _labels(path: Path, name: str, value: NDArray[Any], n_points: int) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Labels 0, 1, ... and their names in the file."""
    value = _numbers(path, name, value, "fiubU")
    if value.shape not in ((n_points,), (n_points, 1), (1, n_points)):
        raise DatasetError(
            f"{path}: field {name} has shape {value.shape}, wanted ({n_points},), a label for each track; or leave it "
            "out"
        )
    value = value.reshape(-1)
    value = value.astype(float) if value.dtype.kind == "f" else value  # 2^53 is no number of half precision
    if value.dtype.kind == "f" and not ((np.abs(value) < 2**53) & (value == np.trunc(value))).all():
        raise DatasetError(f"{path}: field {name} holds NaN or fractions; wanted whole numbers, or leave it out")
    return named(path, name, [f"{v:.0f}" if isinstance(v, float) else str(v) for v in value.tolist()])


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


def check_words(path: Path, field: str, words: list[str]) -> None:
    """Raise DatasetError unless names have 1 to 100 printable characters."""
    odd = next((word for word in words if not (0 < len(word) <= 100 and word.isprintable())), None)
    if odd is not None:
        raise DatasetError(f"{path}: {field} {odd[:40]!a} is not a name, wanted 1 to 100 printable characters")
