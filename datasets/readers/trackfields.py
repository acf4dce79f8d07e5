"""Tracks in array files: the fields of this project, of CoTracker, TAPIR and SLEAP, or named by the user."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.arrayfields import FIELDS
from nrsfm.datasets.readers.axes import arranged, recognise
from nrsfm.datasets.readers.matfile import listed
from nrsfm.datasets.readers.trackfile import RECOGNISED, Asked, TrackFile, check_size, named, unused

#: The names that a field may have.
NAMES: Mapping[str, tuple[str, ...]] = {
    "tracks": ("tracks", "W", "pred_tracks", "points"),
    "visible": ("visible", "visibles", "visibility", "pred_visibility"),
    "occluded": ("occluded", "occlusion", "occlusions"),
    "confidence": ("confidence", "pred_confidence"),
    "cameras": ("cameras", "R", "Rs"),
    "structure": ("structure", "S"),
    "labels": ("labels", "s"),
}
SAVE = "save them as 'tracks' (F, 2, P), or as 'W' (2F, P) with rows x, y for each frame; NaN is not observed"
SURE = 0.5  # confidence from which a position counts as observed
SEEN: Mapping[str, Callable[[Array, float], NDArray[np.bool_]]] = {
    "visible": lambda value, least: value >= least,
    "occluded": lambda value, _: value < (0.5 if value.min() >= 0 and value.max() <= 1 else 0.0),  # else logits
    "confidence": lambda value, least: value >= least,
}


@dataclass(frozen=True)
class Layout:
    """How a program lays out its arrays: the fields that it is known by, and the axes of its tracks."""

    program: str
    marks: frozenset[str]
    axes: tuple[str, ...]
    image: bool = True


OWN = Layout("", frozenset({"tracks", "W"}), ("F,2,P", "F2,P"), image=False)
LAYOUTS = (
    Layout("CoTracker", frozenset({"pred_tracks", "pred_visibility"}), ("F,P,2",)),
    Layout("TAPIR", frozenset({"visibles", "occluded", "occlusion", "expected_dist", "query_points"}), ("P,F,2",)),
    OWN,
    Layout("", frozenset(), (), image=False),
)


def read_fields(path: Path, asked: Asked = RECOGNISED) -> TrackFile:
    """Read an .npz, .npy, .mat or HDF5 file.

    ``tracks`` or ``W`` is (F, 2, P), or (2F, P) with rows x, y for each frame; CoTracker's ``pred_tracks`` are
    (1, F, P, 2), TAPIR's ``tracks`` (P, F, 2). Where the numbers contradict that, or the layout is not known, the axes
    are those of :func:`nrsfm.datasets.readers.axes.recognise`. ``visible``, ``occluded`` and ``confidence`` have the
    tracks' axes without x and y. ``cameras`` are (F, 2, 3) or (2F, 3), ``structure`` (F, 3, P) or (3F, P), ``labels``
    (P,), (P, 1) or (1, P). All but the tracks may be absent. Frames and tracks are named by their index, from 0 on.
    SLEAP's analysis files are read as SLEAP writes them.

    Raises
    ------
    DatasetError
        If the file cannot be read, or a field is there under two names, is not numeric or has another shape.
    """
    source = FIELDS[path.suffix.lower()]
    every = [name for names in NAMES.values() for name in names]
    stored, held = source(path, [*every, *asked.columns.values(), *SLEAP])
    if "tracks" not in asked.columns and not any(name in stored for name in NAMES["tracks"]):
        name = _only(path, held)
        stored, asked = source(path, [name])[0], replace(asked, columns={**asked.columns, "tracks": name})
    return from_arrays(path, stored, held, asked)


def from_arrays(
    path: Path, stored: Mapping[str, NDArray[Any]], held: Mapping[str, str], asked: Asked = RECOGNISED
) -> TrackFile:
    """The tracks in some arrays, as :func:`read_fields`.

    Parameters
    ----------
    path : Path
        For messages.
    stored : mapping
        The arrays by name.
    held : mapping
        The names of everything that there is, also of what is not among the arrays.
    asked : Asked
    """
    if {"tracks", "node_names"} <= set(stored):
        return _sleap(path, stored, held)
    names = {field: _name_of(path, field, asked, stored) for field in NAMES}
    fields = {field: (name, stored[name]) for field, name in names.items() if name is not None}
    used = {name for name, _ in fields.values()}
    layout = next(layout for layout in LAYOUTS if layout.marks & used or not layout.marks)
    name, array = fields["tracks"]
    array = _unbatched(_numbers(path, name, array))
    documented = next((axes for axes in layout.axes if axes.count(",") == array.ndim - 1), "")
    axes, note = recognise(path, name, array, documented, asked.axes)
    if not axes:
        raise DatasetError(f"{path}: field {name} has shape {array.shape}, wanted (F, 2, P) or (2F, P); {SAVE}")
    W = arranged(array, axes)
    F, _, P = W.shape
    check_size(path, F, P)
    W = np.array(W, dtype=float)
    notes = [f"read as {layout.program} writes it, ({axes.replace(',', ', ')})"] if layout.program and not note else []
    notes += [note] if note else []
    time_first = axes.index("F") < axes.index("P")
    for field, seen in SEEN.items():
        if field in fields:
            W, told = _hide(path, field, *fields[field], W, time_first, asked.confidence, seen)
            notes += told
    labels, bodies = _labels(path, *fields["labels"], P) if "labels" in fields else (None, ())
    frames, ids = (tuple(map(str, range(n))) for n in (F, P))
    more = {
        field: _frames(path, *fields[field], rows=rows, columns=columns, frames=F)
        for field, rows, columns in (("cameras", 2, 3), ("structure", 3, P))
        if field in fields
    }
    notes += unused("field", [name for name in held if name not in used])
    return TrackFile(W, frames, ids, labels=labels, bodies=bodies, notes=tuple(notes), image=layout.image, **more)


def _name_of(path: Path, field: str, asked: Asked, stored: Collection[str]) -> str | None:
    """The name under which a field is there, None if it is not."""
    if (name := asked.columns.get(field)) is not None:
        if name not in stored:
            raise DatasetError(f"{path}: there is no field {name[:40]!a} for {field}; see --columns")
        return name
    names = [name for name in NAMES[field] if name in stored]
    if len(names) > 1:
        raise DatasetError(f"{path}: it holds {field} twice, as {' and '.join(names)}; leave one of them out")
    return names[0] if names else None


def _only(path: Path, held: Mapping[str, str]) -> str:
    """The field of tracks in a file of other names: the only one that there is."""
    known = {name for names in NAMES.values() for name in names}
    if len(held) == 1 and not known & set(held):
        return next(iter(held))
    raise DatasetError(f"{path}: it holds no tracks; {SAVE}; or name it, --columns tracks=NAME: {listed(held)}")


def _numbers(path: Path, name: str, value: NDArray[Any], kinds: str = "fiu") -> NDArray[Any]:
    """The value; DatasetError unless its dtype is of one of the kinds."""
    if value.dtype.kind not in kinds:
        raise DatasetError(f"{path}: field {name} is of type {value.dtype}, wanted numbers")
    return value


def _unbatched(value: NDArray[Any]) -> NDArray[Any]:
    """An array of four axes without the first, if that has length 1: trackers take batches of videos."""
    return value[0] if value.ndim == 4 and len(value) == 1 else value


def _frames(path: Path, name: str, value: NDArray[Any], *, rows: int, columns: int, frames: int) -> Array:
    """An array (F, rows, columns), from one of that shape or from (rows F, columns)."""
    value, shape = _numbers(path, name, value), value.shape
    if value.ndim == 2 and value.shape[0] % rows == 0:
        value = value.reshape(value.shape[0] // rows, rows, value.shape[1])
    sizes = (frames, rows, columns)
    if value.shape != sizes:
        raise DatasetError(
            f"{path}: field {name} has shape {shape}, wanted {sizes} or {(rows * frames, columns)}; bring it to the "
            "tracks' frames, or leave it out"
        )
    return np.array(value, dtype=float)


def _hide(
    path: Path,
    field: str,
    name: str,
    value: NDArray[Any],
    W: Array,
    time_first: bool,
    confidence: float | None,
    seen: Callable[[Array, float], NDArray[np.bool_]],
) -> tuple[Array, list[str]]:
    """The tracks with NaN where a field says that they are not observed, and a note on what was decided."""
    F, _, P = W.shape
    wanted = (F, P) if time_first else (P, F)
    value, shape = _numbers(path, name, value, "fiub"), value.shape
    if value.ndim > 2 and value.size == F * P:
        value = value.reshape([n for n in value.shape if n != 1] if 1 not in wanted else wanted)
    if value.shape != wanted:
        raise DatasetError(f"{path}: field {name} has shape {shape}, wanted {wanted}; NaN in the tracks does too")
    flags = np.asarray(value if time_first else value.T, dtype=float)
    if not np.isfinite(flags).all():
        raise DatasetError(f"{path}: field {name} holds NaN or infinite numbers; wanted 0 and 1")
    least = SURE if confidence is None else confidence
    whole = bool(((flags == 0) | (flags == 1)).all())
    if field != "occluded" and not whole and not (flags.min() >= 0 and flags.max() <= 1):
        raise DatasetError(f"{path}: field {name} holds other numbers than 0 to 1; write 1 where a track is observed")
    shown = seen(flags, least)
    lacking = shown & np.isnan(W).any(axis=1)
    if whole and lacking.any():
        frame, track = np.argwhere(lacking)[0]
        raise DatasetError(
            f"{path}: frame {frame}, track {track} is NaN in the tracks and {flags[frame, track]:.0f} in {name}; write "
            f"{1 - flags[frame, track]:.0f} there, or leave {name} out"
        )
    told = "" if whole or field == "occluded" else f"{name} below {least:g} counts as not observed (--confidence)"
    return np.where(shown[:, None], W, np.nan), [told] if told else []


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


SLEAP = ("tracks", "node_names", "track_names")


def _sleap(path: Path, stored: Mapping[str, NDArray[Any]], held: Mapping[str, str]) -> TrackFile:
    """SLEAP's analysis file: ``tracks`` (tracks, 2, nodes, frames); each node of each track is a point."""
    array, nodes = _numbers(path, "tracks", stored["tracks"]), stored["node_names"].ravel().tolist()
    if array.ndim != 4 or array.shape[1:3] != (2, len(nodes)):
        raise DatasetError(f"{path}: tracks has shape {array.shape}, wanted (tracks, 2, {len(nodes)} nodes, frames)")
    n, _, _, F = array.shape
    animals = [str(name) for name in stored.get("track_names", np.array([])).ravel()]
    animals = animals if len(animals) == n else [f"track_{k}" for k in range(n)]
    check_size(path, F, n * len(nodes))
    W = array.transpose(3, 1, 0, 2).reshape(F, 2, n * len(nodes)).astype(float)
    file = TrackFile(W, tuple(map(str, range(F))), tuple(map(str, nodes)), image=True)
    notes = (
        "read as SLEAP writes it, (tracks, 2, nodes, frames)",
        *unused("field", [k for k in held if k not in SLEAP]),
    )
    if n == 1:
        return replace(file, notes=notes)
    ids = tuple(f"{animal}.{node}" for animal in animals for node in nodes)
    labels, bodies = named(path, "track", [animal for animal in animals for _ in nodes])
    return replace(file, ids=ids, labels=labels, bodies=bodies, notes=notes)
