"""The journal of a sweep: one line for each trial that ended, appended by workers, read by the follower."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.outcome import STATUSES


@dataclass(frozen=True)
class Entry:
    """One line of a journal: a trial that ended, and whether it ran in this sweep or before."""

    key: str
    title: str
    status: str
    ran: bool


def note(settings: Settings, entry: Entry) -> None:
    """Append a line to the sweep's journal, in one write, so that the lines of several workers never mix."""
    if settings.sweep:
        path = journal(settings.output, settings.sweep)
        path.parent.mkdir(parents=True, exist_ok=True)
        line = json.dumps(entry.__dict__) + "\n"
        handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            os.write(handle, line.encode())
        finally:
            os.close(handle)


def journal(output: Path, sweep: str) -> Path:
    """The journal's file."""
    return output / "sweeps" / sweep / "trials.jsonl"


def entries(path: Path, start: int = 0) -> Iterator[tuple[Entry, int]]:
    """Entries of a journal from a byte offset on, each with the offset after it; invalid lines are skipped."""
    if not path.is_file():
        return
    with path.open("rb") as stream:
        stream.seek(start)
        for line in stream:
            if not line.endswith(b"\n"):
                return
            start += len(line)
            if entry := _entry(line):
                yield entry, start


def _entry(line: bytes) -> Entry | None:
    """The entry of a line, None if it is invalid."""
    try:
        entry = Entry(**json.loads(line))
    except (ValueError, TypeError, RecursionError):
        return None
    texts = all(type(text) is str for text in (entry.key, entry.title, entry.status))
    return entry if texts and type(entry.ran) is bool and entry.status in STATUSES else None
