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

from harness.environment import environment
from harness.record import Outcome

RESULT, ARRAYS, TRACEBACK, LOG = "result.json", "arrays.npz", "traceback.txt", "log.txt"
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
    """The record of a finished trial, or None; a damaged one counts as not finished."""
    try:
        return Outcome.from_json((folder / RESULT).read_text())
    except (OSError, ValueError):
        return None
