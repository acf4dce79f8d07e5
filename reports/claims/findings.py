"""The verdict on a claim: the runs that it is judged by, and its cases."""

from __future__ import annotations

import statistics
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from nrsfm.harness.record.curves import thinned
from nrsfm.harness.record.tracked import Fetch, Tracked
from nrsfm.reports.layouts import published

HELD, NOT_HELD, NOT_TESTED = "held", "not held", "not tested"
SYMBOLS = {HELD: "✓", NOT_HELD: "✗", NOT_TESTED: "○"}
UMPM = published.datasets("table3")


def word(ok: bool | None) -> str:
    """The verdict on a case."""
    return NOT_TESTED if ok is None else HELD if ok else NOT_HELD


@dataclass(frozen=True)
class Case:
    """One instance of a claim: whether it holds (None: not measured), the evidence in words, and the measured value."""

    name: str
    ok: bool | None
    words: str
    value: float | None = None


@dataclass(frozen=True)
class Finding:
    """The cases of a claim; ``measures`` names their values."""

    cases: tuple[Case, ...]
    measures: str = ""

    @property
    def verdict(self) -> str:
        if any(case.ok is False for case in self.cases):
            return NOT_HELD
        return HELD if self.cases and all(case.ok for case in self.cases) else NOT_TESTED

    @property
    def symbol(self) -> str:
        return SYMBOLS[self.verdict]

    @property
    def figures(self) -> str:
        """``7 of 8 hold, 1 does not; e_3D over BMM's 0.99 to 1.02``."""
        held, against, absent = (sum(case.ok is kind for case in self.cases) for kind in (True, False, None))
        if not held and not against:
            return "no run"
        text = f"{held} of {len(self.cases)} hold"
        text += f", {against} not" * bool(against) + f", {absent} not measured" * bool(absent)
        values = [case.value for case in self.cases if case.value is not None]
        if values and self.measures:
            low, high = f"{min(values):.3g}", f"{max(values):.3g}"
            text += f"; {self.measures} {low}" + (f" to {high}" if high != low else "")
        return text

    @property
    def evidence(self) -> tuple[str, ...]:
        """A line for each case, counterexamples first."""
        order = {False: 0, True: 1, None: 2}
        return tuple(
            f"{SYMBOLS[word(c.ok)]} {c.name}: {c.words}" for c in sorted(self.cases, key=lambda c: order[c.ok])
        )


@dataclass(frozen=True)
class Judged:
    """A claim with its finding."""

    number: int
    statement: str
    rule: str
    experiment: str  #: whose runs judge it
    finding: Finding

    @property
    def verdict(self) -> str:
        return self.finding.verdict


class Evidence:
    """Finished runs on real data with every method as configured, oldest first, and their curves.

    Of one trial the newest run counts. Runs with gaps, or that had to count the bodies, are left out.
    """

    def __init__(self, runs: Iterable[Tracked], fetch: Fetch) -> None:
        judged = (run for run in runs if not run.outcome.gaps and "n_bodies_found" not in run.outcome.metrics)
        self._runs: dict[tuple[Any, ...], Tracked] = {run.outcome.identity: run for run in judged}
        self._fetch = fetch

    def curves(self, dataset: str, method: str) -> list[dict[str, Any]]:
        return [thinned(self._fetch(run)) for run in self._find(dataset, method)]

    def _find(self, dataset: str, method: str, level: float = 0.0, placement: str = "paper") -> list[Tracked]:
        """The runs of a dataset in the paper's setting, one for each draw of the noise."""
        wanted = (dataset, method, level)
        runs = [r for r in self._runs.values() if (r.outcome.dataset, r.outcome.method, r.outcome.level) == wanted]
        if dataset in UMPM:  # as captured, cameras from the tracks
            return runs
        usual = [r for r in runs if r.outcome.cameras == "known" and r.outcome.motion in ("registered", "")]
        return [r for r in usual if r.outcome.placement in (placement, "")]

    def mean(self, metric: str, *where: Any, **more: Any) -> float | None:
        """The metric's mean over draws; None if any run lacks it, or there is none."""
        values = [run.outcome.metrics.get(metric) for run in self._find(*where, **more)]
        known = [value for value in values if value is not None]
        return statistics.fmean(known) if known and len(known) == len(values) else None
