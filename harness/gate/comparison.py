"""Comparison of measured numbers with a baseline, blessed or published: a verdict a metric, and the exit code."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from nrsfm.harness.gate.baseline import Baseline, Blessed, index
from nrsfm.harness.gate.tolerance import BLESSED_TOLERANCES, PUBLISHED_TOLERANCES, Tolerance, tolerance_of
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.text import one_line


class State(StrEnum):
    """Verdict on one metric: within its tolerance, improved or regressed beyond it, or not compared."""

    PASS = "pass"
    IMPROVED = "improved"
    REGRESSED = "regressed"
    MISSING = "missing"
    FAILED = "failed"
    NEW = "new"


@dataclass(frozen=True)
class Line:
    """The verdict on one metric of one row.

    The metric is "" for a verdict on the whole row, ``status`` for one on how its trials ended. ``slack`` is how far
    above the baseline a value still passes, ``why`` why the row could not be compared.
    """

    row: str
    metric: str
    state: State
    baseline: float | None = None
    measured: float | None = None
    slack: float | None = None
    n_points: int | None = None
    why: str = ""

    @property
    def bad(self) -> bool:
        """Whether it makes a gate fail."""
        return self.state in (State.REGRESSED, State.MISSING, State.FAILED)

    @property
    def allowed(self) -> float | None:
        """The largest value that passes."""
        return None if self.baseline is None or self.slack is None else self.baseline + self.slack

    @property
    def cells(self) -> tuple[str, ...]:
        """Row, metric, verdict, baseline, measured, allowed and why; a dash for an absent value."""
        numbers = ("–" if value is None else f"{value:.6g}" for value in (self.baseline, self.measured, self.allowed))
        return (self.row, self.metric or "–", str(self.state), *numbers, self.why or "–")

    @property
    def text(self) -> str:
        """``dance_yoga ours (...): e_3d regressed: 0.0318 -> 0.0402, up to 0.0334 allowed``."""
        name = {"n_wrong": "wrong tracks"}.get(self.metric, self.metric)
        text = f"{self.row}: {name} {self.state}" if self.metric else f"{self.row}: {self.state}"
        if self.baseline is not None and self.measured is not None:
            of = f" of {self.n_points}" if self.metric == "n_wrong" and self.n_points else ""
            text += f": {self.baseline:g} -> {self.measured:g}{of}"
            if self.bad and self.allowed is not None:
                text += f", up to {self.allowed:.4g} allowed"
        return f"{text}: {self.why}" if self.why else text


@dataclass(frozen=True)
class Comparison:
    """The verdicts on all rows, and the name of the baseline."""

    against: str
    lines: tuple[Line, ...]

    @property
    def counts(self) -> Counter[State]:
        """Lines by verdict."""
        return Counter(line.state for line in self.lines)

    @property
    def bad(self) -> tuple[Line, ...]:
        """Lines that make a gate fail."""
        return tuple(line for line in self.lines if line.bad)

    @property
    def code(self) -> int:
        """Exit code: 2 if a line is missing or failed or nothing was compared, else 1 if one regressed, else 0."""
        counts = self.counts
        if counts[State.MISSING] or counts[State.FAILED] or not set(counts) - {State.NEW}:
            return 2
        return 1 if counts[State.REGRESSED] else 0

    @property
    def summary(self) -> str:
        """``Against the blessed baseline: 12 pass, 1 regressed.``"""
        counts = self.counts
        text = ", ".join(f"{counts[state]} {state}" for state in State if counts[state]) or "nothing to compare"
        if self.lines and not set(counts) - {State.NEW}:
            text += "; the baseline has none of it"
        return f"Against {self.against}: {text}."


@dataclass(frozen=True)
class Gate:
    """Comparisons that decide the exit code (``blocking``), and others that are only shown (``informing``)."""

    blocking: tuple[Comparison, ...]
    informing: tuple[Comparison, ...] = ()

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """All of them, those that decide last."""
        return (*self.informing, *self.blocking)

    @property
    def code(self) -> int:
        """The largest exit code of the blocking comparisons."""
        return max((comparison.code for comparison in self.blocking), default=0)


def compare(
    baseline: Baseline,
    outcomes: Iterable[Outcome],
    tolerances: Mapping[str, Tolerance] | None = None,
    against: str = "blessed",
) -> Comparison:
    """Compare measured outcomes with a baseline; UsageError if two of them differ in the method's settings alone.

    Parameters
    ----------
    baseline : Baseline
        The blessed one, or that of :func:`nrsfm.reports.layouts.baseline.published`.
    tolerances : mapping, optional
        Metric or pattern -> Tolerance; an exact name wins over a pattern. A metric of the baseline without a tolerance
        must be measured, but may have any value.
    against : {"blessed", "published"}
        Outcomes that have no published numbers are left out, and so are metrics.
    """
    outcomes = list({outcome.key: outcome for outcome in outcomes}.values())
    if against == "published":
        chosen = tolerances or PUBLISHED_TOLERANCES
        known = {row.key for row in baseline.rows}
        outcomes = [o for o in outcomes if known & {(row := Blessed.of([o])).key, row.other}]
    elif against == "blessed":
        chosen = tolerances or BLESSED_TOLERANCES
    else:
        raise UsageError(f"compare against {one_line(against)!r}: wanted blessed or published")
    measured = index(outcomes, None)
    errors = {Blessed.of([o]).key: o.error for o in outcomes if o.status != OK}
    lines: list[Line] = []
    compared = set()
    for row in sorted(baseline.rows, key=lambda r: r.key):
        now = measured.get(row.key)
        if now is None and row.other in measured and (measured[row.other].status != OK or row.status != OK):
            now = replace(measured[row.other], stand_in=row.stand_in)  # a failed trial may not know its data
            compared.add(row.other)
        if now is not None:
            compared.add(row.key)
            error = errors.get(row.key) or errors.get(row.other, "")
            lines += _row(row, now, error, chosen, complete=against == "blessed")
            continue
        why = _unlike(row.stand_in) if row.other in measured else "not measured"
        compared.add(row.other)
        lines.append(Line(row.title, "", State.MISSING, why=why))
    for key, now in measured.items():
        if key not in compared:
            state = State.NEW if now.status == OK else State.FAILED
            lines.append(Line(now.title, "", state, why=_ended(now.status, errors.get(key, ""))))
    return Comparison("the published numbers" if against == "published" else "the blessed baseline", tuple(lines))


def _row(row: Blessed, now: Blessed, error: str, chosen: Mapping[str, Tolerance], complete: bool) -> Iterator[Line]:
    """The lines of one row; ``complete`` adds metrics that the baseline does not have."""
    if now.status != OK:
        state = State.PASS if row.status != OK else State.FAILED
        yield Line(row.title, "status", state, why=_ended(now.status, error))
        return
    if row.status != OK:
        yield Line(row.title, "status", State.IMPROVED, why=f"was {row.status}, now ok")
        return
    why = ""
    if None not in (row.n_points, now.n_points) and row.n_points != now.n_points:
        why = f"the baseline has {row.n_points} tracks, {now.n_points} were measured: not the same scene"
    elif row.trials and len(row.trials) != len(now.trials):
        why = f"the baseline is over {len(row.trials)} draws, {len(now.trials)} were measured"
    if why:
        yield Line(row.title, "", State.MISSING, why=why)
        return
    if not any(metric in now.metrics and tolerance_of(metric, chosen) for metric in row.metrics):
        yield Line(row.title, "status", State.PASS)
    for metric, blessed in row.metrics.items():
        tolerance = tolerance_of(metric, chosen)
        value = now.metrics.get(metric)
        if value is None:
            yield Line(row.title, metric, State.MISSING, baseline=blessed, why="no longer logged")
        elif tolerance is not None:
            slack = tolerance.slack(blessed, row.spreads.get(metric, 0.0))
            low, high = blessed - slack, blessed + slack
            state = State.REGRESSED if value > high else State.IMPROVED if value < low else State.PASS
            yield Line(row.title, metric, state, blessed, value, slack, now.n_points)
    for metric in now.metrics if complete else ():
        if metric not in row.metrics and metric in chosen:
            yield Line(row.title, metric, State.NEW, measured=now.metrics[metric])


def _unlike(stand_in: bool) -> str:
    blessed, measured = ("a stand-in", "real data") if stand_in else ("real data", "a stand-in")
    return f"the baseline is from {blessed}, the measurement from {measured}: they do not compare"


def _ended(status: str, error: str) -> str:
    error = one_line(error)
    return "" if status == OK else f"{status}: {error}" if error else status
