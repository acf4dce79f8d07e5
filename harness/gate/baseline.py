"""Baselines: committed files of measured numbers that were accepted, with the reason and the date."""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from nrsfm.harness.gate.schema import LARGEST_FILE, SCHEMA, Cell, is_date, parse
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import write_text
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.untrusted import read_bounded

BLESSED = ("n_wrong", "e_3d", "e_3d_total", "e_3d_centred", "e_3d_procrustes", "e_3d_dai", "e_r")
"""Metrics that a baseline keeps; ``n_wrong``, a count of tracks, in place of the share e_ms, which would be rounded."""

WHERE = ("dataset", "method", "cameras", "placement", "motion", "level", "gaps", "stand_in")
"""Fields that tell rows from each other."""

Key = tuple[Any, ...]


def rounded(value: float) -> float:
    """A value to the six significant digits that a baseline keeps."""
    return float(f"{value:.6g}")


@dataclass(frozen=True)
class Blessed:
    """A row of a baseline: one method on one scene, each metric averaged over the noise draws.

    The first fields are those of :class:`nrsfm.harness.record.outcome.Outcome`; ``status`` is that of a draw that did
    not finish, if there is one, and then there are no metrics. ``metrics`` and ``spreads`` are means and sample
    standard deviations over the draws, to six significant digits; ``trials`` are the keys of the draws.
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
        """Identity of the row; real and generated data make two rows."""
        return tuple(getattr(self, name) for name in WHERE)

    @property
    def other(self) -> Key:
        """Key of the same row on generated data where this one is on real data, and the reverse."""
        return (*self.key[:-1], not self.stand_in)

    @property
    def title(self) -> str:
        """``dance_yoga ours (cameras known, placement paper, motion registered)``."""
        words = [f"{name} {word}" for name in ("cameras", "placement", "motion") if (word := getattr(self, name))]
        words += [f"noise {self.level:g}"] * bool(self.level) + [f"gaps {self.gaps}"] * bool(self.gaps)
        words += ["stand-in"] * self.stand_in
        return f"{self.dataset} {self.method} ({', '.join(words)})"

    @classmethod
    def of(cls, draws: Sequence[Outcome], metrics: Sequence[str] | None = BLESSED) -> Blessed:
        """The row of some outcomes, one a draw; ``metrics`` None keeps every metric that all draws have."""
        first = draws[0]
        status = next((o.status for o in draws if o.status != OK), OK)
        values: dict[str, list[float]] = {}
        if status == OK:
            names = [name for name in first.metrics if all(name in o.metrics for o in draws)]
            values = {n: [o.metrics[n] for o in draws] for n in names if metrics is None or n in metrics}
        return cls(
            **{name: getattr(first, name) for name in WHERE},
            status=status,
            n_points=first.n_points if len({o.n_points for o in draws}) == 1 else None,
            metrics={name: rounded(statistics.fmean(v)) for name, v in values.items()},
            spreads={name: rounded(statistics.stdev(v) if len(v) > 1 else 0.0) for name, v in values.items()},
            trials=tuple(sorted(o.key for o in draws)),
        )

    @classmethod
    def of_cell(cls, cell: Cell) -> Blessed:
        """A row with the one metric of a cell."""
        fields = cell.model_dump()
        metric, value, spread, trials = (fields.pop(name) for name in ("metric", "value", "spread", "trials"))
        del fields["count"]
        numbers = ({}, {}) if metric is None else ({metric: value}, {metric: spread})
        return cls(**fields, metrics=numbers[0], spreads=numbers[1], trials=tuple(trials))

    def cells(self) -> list[dict[str, Any]]:
        """The row as it stands in the file: a flat record a metric, or one without a number if it did not finish."""
        names = [name for name in WHERE if name != "gaps"]
        shared = {name: getattr(self, name) for name in (*names, "status", "n_points")}
        shared = {name: value for name, value in shared.items() if value is not None}
        shared |= {"gaps": self.gaps} if self.gaps else {}
        behind = {"count": len(self.trials), "trials": list(self.trials)}
        numbers = sorted(self.metrics.items())
        cells = [{"metric": name, "value": value, "spread": self.spreads.get(name, 0.0)} for name, value in numbers]
        return [shared | cell | behind for cell in cells or [{}]]


@dataclass(frozen=True)
class Baseline:
    """A baseline file: its rows, the reason and date of the last blessing, and earlier (date, reason) pairs."""

    reason: str
    date: str
    rows: tuple[Blessed, ...]
    history: tuple[tuple[str, str], ...] = ()

    def to_json(self) -> str:
        """The file's text: a line a cell, sorted, so that the same rows give the same bytes and a diff shows cells."""
        history = [{"date": date, "reason": reason} for date, reason in self.history]
        head = {"schema": SCHEMA, "reason": self.reason, "date": self.date, "history": history}
        cells = [cell for row in sorted(self.rows, key=lambda r: r.key) for cell in row.cells()]
        lines = ",\n".join("  " + json.dumps(cell, allow_nan=False) for cell in cells)
        return json.dumps(head, indent=1, allow_nan=False)[:-2] + f',\n "rows": [\n{lines}\n ]\n}}\n'

    @classmethod
    def read(cls, path: Path) -> Baseline:
        """Read a file; raises UsageError if it is missing, larger than 4 MiB, or as :meth:`parse`."""
        return cls.parse(path, read_bounded(path, LARGEST_FILE, remedy="make it with 'nrsfm bless'"))

    @classmethod
    def parse(cls, path: Path, text: str | bytes) -> Baseline:
        """Check the text of a file, and join the cells of each row; UsageError names the file and the wrong field."""
        file = parse(path, text)
        rows: dict[Key, Blessed] = {}
        for i, cell in enumerate(file.rows):
            row = Blessed.of_cell(cell)
            known = rows.get(row.key)
            if known is not None:
                if not row.metrics or row.metrics.keys() <= known.metrics.keys():
                    raise UsageError(f"{path}: rows[{i}] {row.title} is there twice; remove one")
                if replace(row, metrics={}, spreads={}) != replace(known, metrics={}, spreads={}):
                    raise UsageError(f"{path}: rows[{i}] {row.title} is not of the same trials as its other cells")
                row = replace(row, metrics=known.metrics | row.metrics, spreads=known.spreads | row.spreads)
            rows[row.key] = row
        history = tuple((entry.date, entry.reason) for entry in file.history)
        return cls(file.reason, file.date, tuple(rows.values()), history)


def index(outcomes: Iterable[Outcome], metrics: Sequence[str] | None = BLESSED) -> dict[Key, Blessed]:
    """Rows by :attr:`Blessed.key`, each over the noise draws among the outcomes.

    Raises UsageError if two outcomes are the same draw: they differ in settings, which a baseline does not hold.
    """
    groups: dict[Key, dict[int, Outcome]] = {}
    for outcome in {outcome.key: outcome for outcome in outcomes}.values():
        row = Blessed.of([outcome])
        draws = groups.setdefault(row.key, {})
        if outcome.repeat in draws:
            raise UsageError(f"two runs of {row.title} differ in settings only; choose one setting of the method")
        draws[outcome.repeat] = outcome
    return {key: Blessed.of(list(draws.values()), metrics) for key, draws in groups.items()}


def bless(outcomes: Iterable[Outcome], path: Path, reason: str, date: str) -> Baseline:
    """Replace a baseline file by measured outcomes; its earlier reasons stay as history.

    The outcomes are all rows of the new baseline; failed ones are kept with their status. ``reason`` says why these
    numbers are right, ``date`` is a day, YYYY-MM-DD. UsageError says which of them cannot be used, or that the present
    file cannot be read.
    """
    reason = " ".join(reason.split())
    if not reason:
        raise UsageError("a baseline needs a reason: say why these numbers are right")
    if not is_date(date):
        raise UsageError(f"date {date!r} is not of the form YYYY-MM-DD")
    rows = tuple(index(outcomes).values())
    if not rows:
        raise UsageError("nothing to bless: no trial has run")
    before = Baseline.read(path) if path.exists() else None
    history = (*before.history, (before.date, before.reason)) if before else ()
    baseline = Baseline(reason, date, rows, history)
    text = baseline.to_json()
    Baseline.parse(path, text)  # nothing is written that could not be read again
    try:
        write_text(path, text)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from None
    return replace(baseline, rows=tuple(sorted(rows, key=lambda row: row.key)))
