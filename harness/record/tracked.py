"""A trial's record as the tracker holds it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.trial import Trial


@dataclass(frozen=True)
class Tracked:
    """A trial's record as the tracker holds it, and the run it stands in."""

    outcome: Outcome
    run_id: str
    uri: str


Answer = tuple[Trial, Tracked | None]


Arrays = Mapping[str, Any]


#: Gives the arrays that a run left, affinities perhaps sparse; empty if it left none.
Fetch = Callable[[Tracked], Arrays]
