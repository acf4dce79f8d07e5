"""The journal of a sweep: one line for each trial that ended, appended by workers, read by the follower."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Predicate

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.outcome import STATUSES
from nrsfm.harness.record.untrusted import checked


@dataclass(frozen=True)
class Entry:
    """One line of a journal: a trial that ended, and whether it ran in this sweep or before."""

    key: str
    title: str
    status: Annotated[str, Predicate(STATUSES.__contains__)]
    ran: bool


def note(settings: Settings, entry: Entry) -> None:
    """Append a line to the sweep's journal, in one write, so that the lines of several workers never mix."""
    if settings.sweep:
        path = journal(settings.output, settings.sweep)
        path.parent.mkdir(parents=True, exist_ok=True)
        line = json.dumps(entry.__dict__) + "\n"
        with path.open("ab", buffering=0) as stream:
            stream.write(line.encode())


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
            with suppress(ValueError):
                yield checked(Entry, line), start
