"""Blessed numbers: a committed file of what measured runs gave, why they were accepted, and when."""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from nrsfm.harness.gate.untrusted import Fields, is_date, load
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import write_text
from nrsfm.harness.record.outcome import OK, STATUSES, Outcome

SCHEMA = 2


LARGEST_REASON = 2000


BLESSED = ("n_wrong", "e_3d", "e_3d_total", "e_3d_centred", "e_3d_procrustes", "e_3d_dai", "e_r")
"""Metrics that a baseline keeps. ``n_wrong`` stands for e_ms, so that no share of tracks is rounded."""


Key = tuple[str, str, str, str, str, float, str, bool]


def rounded(value: float) -> float:
    """To the six significant digits that a baseline keeps."""
    return float(f"{value:.6g}")


@dataclass(frozen=True)
class Blessed:
    """What a reader calls one row of a table's method, and its numbers: the mean over the noise's draws.

    Parameters
    ----------
    dataset, method, cameras, placement, motion, level, gaps
        As in :class:`nrsfm.harness.record.outcome.Outcome`.
    stand_in : bool
        Measured on generated data; never compared with real data.
    status : str
        As in the trials' records, of one that did not finish if there is any; only ``ok`` rows have metrics.
    n_points : int or None
        Tracks of the scene.
    metrics, spreads : dict
        Means and sample standard deviations over the draws, to six significant digits.
    trials : tuple of str
        The draws' trial keys.
    """

    dataset: str
    method: str
    cameras: str
    placement: str
    motion: str
    level: float
    gaps: str = ""
    stand_in: bool = False
    status: str = OK
    n_points: int | None = None
    metrics: dict[str, float] = field(default_factory=dict)
    spreads: dict[str, float] = field(default_factory=dict)
    trials: tuple[str, ...] = ()

    @property
    def key(self) -> Key:
        """Real and generated data make two rows."""
        words = (self.dataset, self.method, self.cameras, self.placement, self.motion)
        return (*words, self.level, self.gaps, self.stand_in)

    @property
    def other(self) -> Key:
        """The key of the same row on the other kind of data."""
        return (*self.key[:-1], not self.stand_in)

    @property
    def title(self) -> str:
        """``dance_yoga ours (cameras known, placement paper, motion registered)``."""
        said = [f"{name} {word}" for name in ("cameras", "placement", "motion") if (word := getattr(self, name))]
        said += [f"noise {self.level:g}"] * bool(self.level) + [f"gaps {self.gaps}"] * bool(self.gaps)
        said += ["stand-in"] * self.stand_in
        return f"{self.dataset} {self.method} ({', '.join(said)})"

    @classmethod
    def of(cls, draws: Sequence[Outcome], metrics: Sequence[str] | None = BLESSED) -> Blessed:
        """The outcomes of one row, a draw each; ``metrics`` None keeps all that every draw has."""
        first = draws[0]
        status = next((o.status for o in draws if o.status != OK), OK)
        values: dict[str, list[float]] = {}
        if status == OK:
            names = [name for name in first.metrics if all(name in o.metrics for o in draws)]
            values = {n: [o.metrics[n] for o in draws] for n in names if metrics is None or n in metrics}
        return cls(
            first.dataset,
            first.method,
            first.cameras,
            first.placement,
            first.motion,
            float(first.level),
            first.gaps,
            first.stand_in,
            status,
            first.n_points if len({o.n_points for o in draws}) == 1 else None,
            {name: rounded(statistics.fmean(v)) for name, v in values.items()},
            {name: rounded(statistics.stdev(v) if len(v) > 1 else 0.0) for name, v in values.items()},
            tuple(sorted(o.key for o in draws)),
        )

    def cells(self) -> list[dict[str, Any]]:
        """One flat record a metric; one without a number for a row that did not finish."""
        words = ("dataset", "method", "cameras", "placement", "motion", "level", "stand_in", "status", "n_points")
        shared = {name: getattr(self, name) for name in words if getattr(self, name) is not None}
        shared |= {"gaps": self.gaps} if self.gaps else {}
        behind = {"count": len(self.trials), "trials": list(self.trials)}
        numbers = [
            {"metric": name, "value": value, "spread": self.spreads.get(name, 0.0)}
            for name, value in sorted(self.metrics.items())
        ]
        return [shared | number | behind for number in numbers or [{}]]


@dataclass(frozen=True)
class Baseline:
    """What :func:`bless` wrote: the reason and date of the last blessing, earlier ones, and the rows."""

    reason: str
    date: str
    rows: tuple[Blessed, ...]
    history: tuple[tuple[str, str], ...] = ()

    def to_json(self) -> str:
        """One line a cell, sorted and rounded: the same rows give the same bytes, and a review reads line by line."""
        head = {
            "schema": SCHEMA,
            "reason": self.reason,
            "date": self.date,
            "history": [{"date": date, "reason": reason} for date, reason in self.history],
        }
        cells = [cell for row in sorted(self.rows, key=lambda r: r.key) for cell in row.cells()]
        lines = ",\n".join("  " + json.dumps(cell, allow_nan=False) for cell in cells)
        return json.dumps(head, indent=1, allow_nan=False)[:-2] + f',\n "rows": [\n{lines}\n ]\n}}\n'

    @classmethod
    def read(cls, path: Path) -> Baseline:
        """Read a baseline file, trusting nothing in it.

        Raises
        ------
        UsageError
            Naming the file and the field, if it is missing, too large, not JSON or not a baseline.
        """
        return _baseline(Fields(path, load(path, remedy="make it with 'nrsfm bless'")))


def index(outcomes: Iterable[Outcome], metrics: Sequence[str] | None = BLESSED) -> dict[Key, Blessed]:
    """Outcomes as rows by :attr:`Blessed.key`, the draws of one row together.

    Raises
    ------
    UsageError
        If a draw is there twice: the runs differ in the method's settings alone, which no baseline names.
    """
    groups: dict[Key, dict[int, Outcome]] = {}
    for outcome in {outcome.key: outcome for outcome in outcomes}.values():
        row = Blessed.of([outcome])
        draws = groups.setdefault(row.key, {})
        if outcome.repeat in draws:
            raise UsageError(f"two runs of {row.title} differ in settings only; choose one setting of the method")
        draws[outcome.repeat] = outcome
    return {key: Blessed.of(list(draws.values()), metrics) for key, draws in groups.items()}


def bless(
    outcomes: Iterable[Outcome], path: Path, reason: str, date: str, metrics: Sequence[str] = BLESSED
) -> Baseline:
    """Make measured outcomes the baseline, in place of whatever the file held.

    Parameters
    ----------
    outcomes : iterable of Outcome
        All rows of the new baseline; failed ones are kept with their status.
    path : Path
        The file; its earlier reasons are carried over as history.
    reason : str
        Why these numbers are right; must not be empty.
    date : str
        Day of the blessing, YYYY-MM-DD.
    metrics : sequence of str
        Metrics to keep.

    Raises
    ------
    UsageError
        If the reason is empty, the date is none, there is nothing to bless, two outcomes have one identity, or
        the file that is there cannot be read.
    """
    reason = " ".join(reason.split())
    if not reason:
        raise UsageError("a baseline needs a reason: say why these numbers are right")
    if not is_date(date):
        raise UsageError(f"date {date!r} is not of the form YYYY-MM-DD")
    rows = tuple(index(outcomes, metrics).values())
    if not rows:
        raise UsageError("nothing to bless: no trial has run")
    before = Baseline.read(path) if path.exists() else None
    history = (*before.history, (before.date, before.reason)) if before else ()
    baseline = Baseline(reason, date, rows, history)
    text = baseline.to_json()
    _baseline(Fields(path, json.loads(text)))  # nothing is written that could not be read again
    try:
        write_text(path, text)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from None
    return replace(baseline, rows=tuple(sorted(rows, key=lambda row: row.key)))


def _baseline(file: Fields) -> Baseline:
    """Every field checked; the first that is wrong is named."""
    file.only(("schema", "reason", "date", "rows"), ("history",))
    if (schema := file.count("schema")) != SCHEMA:
        file.wrong("schema", f"is {schema}, this version reads {SCHEMA}; bless anew")
    rows: dict[Key, Blessed] = {}
    for fields in file.objects("rows"):
        cell = _cell(fields)
        row = rows.get(cell.key)
        if row is not None:
            if not cell.metrics or cell.metrics.keys() <= row.metrics.keys():
                file.wrong(fields.where, f"{cell.title} stands twice")
            if replace(cell, metrics={}, spreads={}) != replace(row, metrics={}, spreads={}):
                file.wrong(fields.where, f"{cell.title} is not of the same trials as its other cells")
            cell = replace(row, metrics=row.metrics | cell.metrics, spreads=row.spreads | cell.spreads)
        rows[cell.key] = cell
    if not rows:
        file.wrong("rows", "is empty")
    history = []
    for entry in file.objects("history"):
        entry.only(("date", "reason"))
        history.append((entry.day("date"), entry.text("reason", LARGEST_REASON)))
    return Baseline(file.text("reason", LARGEST_REASON), file.day("date"), tuple(rows.values()), tuple(history))


def _cell(row: Fields) -> Blessed:
    """A row with one metric at most."""
    words = ("dataset", "method", "cameras", "placement", "motion")
    numbers = ("metric", "value", "spread")
    row.only((*words, "level", "stand_in", "status", "count", "trials"), ("gaps", *numbers, "n_points"))
    status = row.text("status")
    if status not in STATUSES:
        row.wrong("status", f"is {status!r}, wanted one of {', '.join(STATUSES)}")
    if ("metric" in row.data) != (status == OK):
        row.wrong("metric", f"{'is there' if status != OK else 'is missing'}, and the status is {status}")
    metrics, spreads = {}, {}
    if status == OK:
        row.only((*words, "level", "stand_in", "status", "count", "trials", *numbers), ("gaps", "n_points"))
        name = row.text("metric", 60)
        if not name.isidentifier():
            row.wrong("metric", f"is {name!r}, wanted a metric's name")
        metrics, spreads = {name: row.number("value")}, {name: row.number("spread")}
    blessed = Blessed(
        dataset=row.text("dataset"),
        method=row.text("method"),
        cameras=row.text("cameras"),
        placement=row.text("placement", empty=True),
        motion=row.text("motion", empty=True),
        level=row.number("level"),
        gaps=row.text("gaps") if "gaps" in row.data else "",
        stand_in=row.flag("stand_in"),
        status=status,
        n_points=row.count("n_points") if "n_points" in row.data else None,
        metrics=metrics,
        spreads=spreads,
        trials=tuple(row.texts("trials")),
    )
    if row.count("count") != len(blessed.trials):
        row.wrong("count", f"is {row.data['count']}, and there are {len(blessed.trials)} trials")
    if blessed.n_points is not None and blessed.metrics.get("n_wrong", 0) > blessed.n_points:
        row.wrong("value", f"is above the {blessed.n_points} tracks of the scene")
    return blessed
