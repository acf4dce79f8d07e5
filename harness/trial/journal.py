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
    """One line of a sweep's journal: the trial that ended and whether it ran now or was done before."""

    key: str
    title: str
    status: str
    ran: bool


def note(settings: Settings, entry: Entry) -> None:
    """Append a line to the sweep's journal; one write, so that workers' lines never mix."""
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
    return output / "sweeps" / sweep / "trials.jsonl"


def entries(path: Path, start: int = 0) -> Iterator[tuple[Entry, int]]:
    """Whole lines of a journal from a byte offset on, each with the offset behind it; other lines are passed over."""
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
    try:
        found = Entry(**json.loads(line))
    except (ValueError, TypeError, RecursionError):
        return None
    texts = all(type(text) is str for text in (found.key, found.title, found.status))
    return found if texts and type(found.ran) is bool and found.status in STATUSES else None
