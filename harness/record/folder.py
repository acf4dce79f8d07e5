"""A trial's folder: the names of its files, and reading and writing them so that nothing is ever half there."""

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

RESULT, ARRAYS, TRACEBACK, LOG = "result.json", "arrays.npz", "traceback.txt", "log.txt"


LARGEST_RECORD = 4 << 20  # bytes


MOST_LABELS = 1000


#: Sizes of a trial's arrays: F frames, P tracks, others as they come.
SHAPES = {"tracks": "F2P", "structure": "F3P", "true_structure": "F3P", "cameras": "F23", "visible": "FP"}
SHAPES |= {"labels": "P", "true_labels": "P", "edges": "E2", "alignment": "33", "affinity": "PP"}
SHAPES |= {"affinity_rows": "N", "affinity_columns": "N", "affinity_values": "N", "affinity_size": ""}


BELOW = ("labels", "true_labels", "edges", "affinity_rows", "affinity_columns", "affinity_size")  # whole numbers


LEAST = 1 << 20  # bytes of a disk that count as none


TRACKED = "tracked.txt"  # the store that holds the record, and the record's time


def write_record(folder: Path, outcome: Outcome) -> None:
    """Write ``result.json``, the mark of a finished trial, atomically; to its environment comes that of the process."""
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    outcome = replace(outcome, finished=now, environment={**environment(), **outcome.environment})
    write_atomically(folder / RESULT, lambda handle: handle.write(outcome.to_json().encode()))


def write_atomically(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Write a file so that it is there whole or not at all, whatever is killed."""
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
    """Raise OSError where next to nothing can be written any more, so that a full disk is not taken for a failure."""
    if shutil.disk_usage(folder).free < LEAST:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder))


def write_text(path: Path, text: str) -> None:
    """:func:`write_atomically` of a text, as UTF-8."""
    write_atomically(path, lambda handle: handle.write(text.encode()))


def pack(parts: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Arrays as a file keeps them: in single precision and 32-bit integers, for figures and later reading.

    A sparse matrix, which is symmetric, becomes the rows, columns and values of its upper triangle, and its size.
    """
    packed: dict[str, NDArray[Any]] = {}
    for name, value in parts.items():
        if sp.issparse(value):
            upper = sp.triu(value, format="coo")
            n = value.shape[0]
            packed |= {f"{name}_rows": upper.row, f"{name}_columns": upper.col, f"{name}_values": upper.data}
            packed |= {f"{name}_size": np.array(n)}
        else:
            packed[name] = np.asarray(value)
    return {name: _compact(value) for name, value in packed.items()}


def unpack(stored: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """What :func:`pack` was given, with sparse matrices as scipy has them."""
    parts = dict(stored)
    for name in [key.removesuffix("_size") for key in stored if key.endswith("_size")]:
        rows, columns, values = (parts.pop(f"{name}_{part}") for part in ("rows", "columns", "values"))
        n = int(parts.pop(f"{name}_size"))
        upper = sp.csr_array((values, (rows, columns)), shape=(n, n))
        parts[name] = upper + sp.triu(upper, k=1).T
    return parts


def _compact(value: NDArray[Any]) -> NDArray[Any]:
    if value.dtype == np.float64:
        return value.astype(np.float32)
    return value.astype(np.int32) if value.dtype == np.int64 else value


def read_record(folder: Path) -> Outcome | None:
    """The record of a finished trial, or None; a damaged one, or another trial's, counts as not finished."""
    try:
        with (folder / RESULT).open("rb") as stream:
            raw = stream.read(LARGEST_RECORD + 1)
        if len(raw) > LARGEST_RECORD:
            return None
        outcome = Outcome.from_json(raw.decode())
    except (OSError, ValueError):
        return None
    return outcome if outcome.key == folder.name else None


def read_arrays(path: Path) -> dict[str, Any]:
    """The arrays of a trial's folder, as :func:`pack` was given them.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If it cannot be read, or its arrays do not fit each other.
    """
    stored = read_npz(path)
    for name in stored:
        if why := _misfit(name, stored):
            raise DatasetError(f"{path}: {why}; remove its folder and run the trial again")
    return unpack(stored)


def _misfit(name: str, stored: Mapping[str, NDArray[Any]]) -> str:
    """Why an array is not what a trial leaves under that name, beside the others; "" if it is."""
    value, tracks = stored[name], stored.get("tracks", np.zeros((0, 2, 0)))
    sizes = dict(zip("F2P", tracks.shape, strict=False)) | {"2": 2, "3": 3}
    letters = SHAPES.get(name, "K" if name.startswith("history_") else "F" if name.startswith("frame_") else None)
    if letters is None:
        return f"it holds {name[:40]!a}, which no trial leaves"
    wanted = tuple(sizes.get(letter) for letter in letters)
    fits = value.ndim == len(wanted) and all(w in (None, n) for n, w in zip(value.shape, wanted, strict=True))
    if not fits or (name == "tracks" and 0 in value.shape):
        return f"{name[:40]!a} has shape {value.shape}, which does not fit the tracks"
    if value.dtype.kind not in ("b" if name == "visible" else "iu" if name in BELOW else "fiu"):
        return f"{name[:40]!a} holds {value.dtype}"
    top = min(sizes["P"], MOST_LABELS) if name.endswith("labels") else sizes["P"]
    if name == "affinity_size":
        return "" if value == top else f"the affinity is not of {top} tracks"
    if name in BELOW and value.size and not (value.min() >= 0 and value.max() < top):
        return f"{name!a} holds numbers that are not in 0..{top - 1}"
    others = [part for part in SHAPES if part.startswith("affinity_") and name.startswith("affinity_")]
    if len({stored[part].size for part in others[:-1] if part in stored}) > 1 or not stored.keys() >= set(others):
        return "the parts of the affinity do not fit each other"
    return ""
