"""A trial's folder: its files, written whole or not at all, and checked when they are read."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.npzfile import read_npz
from nrsfm.harness.record.environment import environment
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.untrusted import read_bounded

RESULT, ARRAYS, TRACEBACK, LOG = "result.json", "arrays.npz", "traceback.txt", "log.txt"

LARGEST_RECORD = 4 << 20  # bytes

MOST_LABELS = 1000
#: Shapes of a trial's arrays by letter: F frames, P tracks, digits for themselves, other letters for any size.
SHAPES = {"tracks": "F2P", "structure": "F3P", "true_structure": "F3P", "cameras": "F23", "visible": "FP"}
SHAPES |= {"outliers": "FP", "scales": "F"}
SHAPES |= {"labels": "P", "true_labels": "P", "edges": "E2", "alignment": "33", "affinity": "PP"}
SHAPES |= {"affinity_rows": "N", "affinity_columns": "N", "affinity_values": "N", "affinity_size": ""}

#: Arrays of whole numbers below the number of tracks or of labels.
INDICES = ("labels", "true_labels", "edges", "affinity_rows", "affinity_columns", "affinity_size")

LEAST = 1 << 20  # free bytes below which a disk counts as full

TRACKED = "tracked.txt"  # names the store that holds the record, and the record's time


def write_record(folder: Path, outcome: Outcome) -> None:
    """Write ``result.json``, which marks a trial as finished, with the time and this process's environment added."""
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    outcome = replace(outcome, finished=now, environment={**environment(), **outcome.environment})
    write_text(folder / RESULT, outcome.to_json())


def write_atomically(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Write a file so that a kill at any moment leaves it whole, or as it was."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            write(stream)
            stream.flush()
            os.fsync(stream.fileno())
        Path(name).chmod(0o644)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def check_space(folder: Path) -> None:
    """Raise OSError if the disk is full, so that a full disk is not taken for a method's failure."""
    if shutil.disk_usage(folder).free < LEAST:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder))


def write_text(path: Path, text: str) -> None:
    """Write a text as UTF-8, whole or not at all."""
    write_atomically(path, lambda handle: handle.write(text.encode()))


def pack(parts: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Arrays as they are stored: in single precision and 32-bit integers, without those that are None.

    A sparse matrix, which must be symmetric, becomes the rows, columns and values of its upper triangle and its size.
    """
    packed: dict[str, NDArray[Any]] = {}
    for name, value in parts.items():
        if sp.issparse(value):
            upper = sp.triu(value, format="coo")
            n = value.shape[0]
            packed |= {f"{name}_rows": upper.row, f"{name}_columns": upper.col, f"{name}_values": upper.data}
            packed |= {f"{name}_size": np.array(n)}
        elif value is not None:
            packed[name] = np.asarray(value)
    smaller = {np.dtype(np.float64): np.float32, np.dtype(np.int64): np.int32}
    return {name: value.astype(smaller.get(value.dtype, value.dtype), copy=False) for name, value in packed.items()}


def unpack(stored: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Undo :func:`pack`; affinities become scipy's sparse arrays again."""
    parts = dict(stored)
    for name in [key.removesuffix("_size") for key in stored if key.endswith("_size")]:
        rows, columns, values = (parts.pop(f"{name}_{part}") for part in ("rows", "columns", "values"))
        n = int(parts.pop(f"{name}_size"))
        upper = sp.csr_array((values, (rows, columns)), shape=(n, n))
        parts[name] = upper + sp.triu(upper, k=1).T
    return parts


def read_record(folder: Path) -> Outcome | None:
    """The record of a finished trial; None if it is missing, damaged or another trial's."""
    try:
        outcome = Outcome.from_json(read_bounded(folder / RESULT, LARGEST_RECORD))
    except ValueError:
        return None
    return outcome if outcome.key == folder.name else None


def read_arrays(path: Path) -> dict[str, Any]:
    """The arrays of a trial, as they were before :func:`pack`; DatasetError if they are missing or do not fit."""
    stored = read_npz(path)
    for name in stored:
        if why := _misfit(name, stored):
            raise DatasetError(f"{path}: {why}; remove its folder and run the trial again")
    return unpack(stored)


def _misfit(name: str, stored: Mapping[str, NDArray[Any]]) -> str:
    """Why an array does not fit its name or the other arrays of a trial; "" if it does."""
    value, tracks = stored[name], stored.get("tracks", np.zeros((0, 2, 0)))
    sizes = dict(zip("F2P", tracks.shape, strict=False)) | {"2": 2, "3": 3}
    letters = SHAPES.get(name, "K" if name.startswith("history_") else "F" if name.startswith("frame_") else None)
    if letters is None:
        return f"it holds {name[:40]!a}, which no trial writes"
    shape = tuple(sizes.get(letter) for letter in letters)
    fits = value.ndim == len(shape) and all(size in (None, n) for n, size in zip(value.shape, shape, strict=True))
    if not fits or (name == "tracks" and 0 in value.shape):
        return f"{name[:40]!a} has shape {value.shape}, which does not fit the tracks"
    if value.dtype.kind not in ("b" if name in ("visible", "outliers") else "iu" if name in INDICES else "fiu"):
        return f"{name[:40]!a} holds {value.dtype}"
    top = min(sizes["P"], MOST_LABELS) if name.endswith("labels") else sizes["P"]
    if name == "affinity_size":
        return "" if value == top else f"the affinity is not of {top} tracks"
    if name in INDICES and value.size and not (value.min() >= 0 and value.max() < top):
        return f"{name!a} holds numbers that are not in 0..{top - 1}"
    parts = [part for part in SHAPES if part.startswith("affinity_") and name.startswith("affinity_")]
    if len({stored[part].size for part in parts[:-1] if part in stored}) > 1 or not stored.keys() >= set(parts):
        return "the parts of the affinity do not fit each other"
    return ""
