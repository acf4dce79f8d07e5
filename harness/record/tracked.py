"""A trial's record in the tracker."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.trial import Trial


@dataclass(frozen=True)
class Tracked:
    """A trial's record, the MLflow run that holds it and the tracker's address; both "" for a record of a folder."""

    outcome: Outcome
    run_id: str
    uri: str


#: A trial and the run that answers it.
Answer = tuple[Trial, Tracked | None]

Arrays = Mapping[str, Any]

#: Gives the arrays of a run, affinities perhaps sparse; empty if it has none.
Fetch = Callable[[Tracked], Arrays]
