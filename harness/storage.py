"""A trial's folder: the names of its files, and reading and writing them so that nothing is ever half there."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

from harness.environment import environment
from harness.record import Outcome

RESULT, ARRAYS, TRACEBACK, LOG = "result.json", "arrays.npz", "traceback.txt", "log.txt"
TRACKED = "tracked.txt"  # the store that holds the record, and the record's time


def write_record(folder: Path, outcome: Outcome) -> None:
    """Write ``result.json``, the mark of a finished trial, atomically."""
    outcome = replace(outcome, finished=datetime.now(UTC).isoformat(timespec="milliseconds"), environment=environment())
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


def write_text(path: Path, text: str) -> None:
    """:func:`write_atomically` of a text, as UTF-8."""
    write_atomically(path, lambda handle: handle.write(text.encode()))


def read_record(folder: Path) -> Outcome | None:
    """The record of a finished trial, or None; a damaged one counts as not finished."""
    try:
        return Outcome.from_json((folder / RESULT).read_text())
    except (OSError, ValueError):
        return None
