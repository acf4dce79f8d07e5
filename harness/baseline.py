"""Blessed numbers: a committed file of what measured runs gave, why they were accepted, and when."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from harness.record import OK, STATUSES, Outcome, UsageError
from harness.storage import write_atomically
from harness.untrusted import Fields, is_date, load

SCHEMA = 1
LARGEST_REASON = 2000
BLESSED = ("n_wrong", "e_3d", "e_3d_total", "e_3d_centred", "e_3d_procrustes", "e_3d_dai", "e_r")
"""Metrics that a baseline keeps. ``n_wrong`` stands for e_ms, so that no share of tracks is rounded."""

Identity = tuple[str, str, str, str, str, float, int]


def rounded(value: float) -> float:
    """To the six significant digits that a baseline keeps."""
    return float(f"{value:.6g}")


@dataclass(frozen=True)
class Blessed:
    """One row: what a reader calls it, and its numbers.

    Parameters
    ----------
    dataset, method, cameras, placement, motion, level, repeat
        As in :attr:`harness.record.Outcome.identity`.
    stand_in : bool
        Measured on generated data; never compared with real data.
    status : str
        As in the trial's record; only ``ok`` rows have metrics.
    n_points : int or None
        Tracks of the scene.
    metrics : dict
        Finite numbers to six significant digits.
    """

    dataset: str
    method: str
    cameras: str
    placement: str
    motion: str
    level: float
    repeat: int
    stand_in: bool = False
    status: str = OK
    n_points: int | None = None
    metrics: dict[str, float] = field(default_factory=dict)

    @property
    def identity(self) -> Identity:
        return (self.dataset, self.method, self.cameras, self.placement, self.motion, self.level, self.repeat)

    @property
    def key(self) -> tuple[Identity, bool]:
        """Real and generated data make two rows."""
        return (self.identity, self.stand_in)

    @property
    def title(self) -> str:
        """``dance_yoga ours (cameras known, placement paper, motion registered)``."""
        said = [f"{name} {word}" for name in ("cameras", "placement", "motion") if (word := getattr(self, name))]
        said += [f"noise {self.level:g} #{self.repeat}"] * bool(self.level or self.repeat) + [
            "stand-in"
        ] * self.stand_in
        return f"{self.dataset} {self.method} ({', '.join(said)})"

    @classmethod
    def of(cls, outcome: Outcome, metrics: Sequence[str] | None = BLESSED) -> Blessed:
        """An outcome as a row; ``metrics`` None keeps all."""
        kept = {k: rounded(v) for k, v in outcome.metrics.items() if metrics is None or k in metrics}
        return cls(
            outcome.dataset,
            outcome.method,
            outcome.cameras,
            outcome.placement,
            outcome.motion,
            float(outcome.level),
            int(outcome.repeat),
            outcome.stand_in,
            outcome.status,
            outcome.n_points,
            kept if outcome.status == OK else {},
        )


@dataclass(frozen=True)
class Baseline:
    """What :func:`bless` wrote: the reason and date of the last blessing, earlier ones, and the rows."""

    reason: str
    date: str
    rows: tuple[Blessed, ...]
    history: tuple[tuple[str, str], ...] = ()

    def to_json(self) -> str:
        """Sorted and rounded: the same rows give the same bytes."""
        data = {
            "schema": SCHEMA,
            "reason": self.reason,
            "date": self.date,
            "history": [{"date": date, "reason": reason} for date, reason in self.history],
            "rows": [
                {k: v for k, v in asdict(row).items() if v is not None}
                for row in sorted(self.rows, key=lambda r: r.key)
            ],
        }
        return json.dumps(data, indent=1, sort_keys=True, allow_nan=False) + "\n"

    @classmethod
    def read(cls, path: Path) -> Baseline:
        """Read a baseline file, trusting nothing in it.

        Raises
        ------
        UsageError
            Naming the file and the field, if it is missing, too large, not JSON or not a baseline.
        """
        return _baseline(Fields(path, load(path, remedy="make it with 'harness bless'")))


def index(rows: Iterable[Blessed]) -> dict[tuple[Identity, bool], Blessed]:
    """Rows by :attr:`Blessed.key`.

    Raises
    ------
    UsageError
        If two rows have one identity: they differ in the method's settings alone, which no baseline names.
    """
    found: dict[tuple[Identity, bool], Blessed] = {}
    for row in rows:
        if row.key in found:
            raise UsageError(f"two runs of {row.title} differ in settings only; choose one setting of the method")
        found[row.key] = row
    return found


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
    once = {outcome.key: outcome for outcome in outcomes}
    rows = tuple(index(Blessed.of(outcome, metrics) for outcome in once.values()).values())
    if not rows:
        raise UsageError("nothing to bless: no trial has run")
    before = Baseline.read(path) if path.exists() else None
    history = (*before.history, (before.date, before.reason)) if before else ()
    baseline = Baseline(reason, date, rows, history)
    text = baseline.to_json()
    _baseline(Fields(path, json.loads(text)))  # nothing is written that could not be read again
    try:
        write_atomically(path, lambda handle: handle.write(text.encode()))
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from None
    return replace(baseline, rows=tuple(sorted(rows, key=lambda row: row.key)))


def _baseline(file: Fields) -> Baseline:
    """Every field checked; the first that is wrong is named."""
    file.only(("schema", "reason", "date", "rows"), ("history",))
    if (schema := file.count("schema")) != SCHEMA:
        file.wrong("schema", f"is {schema}, this version reads {SCHEMA}; bless anew")
    rows: dict[tuple[Identity, bool], Blessed] = {}
    for fields in file.objects("rows"):
        row = _row(fields)
        if row.key in rows:
            file.wrong(fields.where, f"{row.title} stands twice")
        rows[row.key] = row
    if not rows:
        file.wrong("rows", "is empty")
    history = []
    for entry in file.objects("history"):
        entry.only(("date", "reason"))
        history.append((entry.day("date"), entry.text("reason", LARGEST_REASON)))
    return Baseline(file.text("reason", LARGEST_REASON), file.day("date"), tuple(rows.values()), tuple(history))


def _row(row: Fields) -> Blessed:
    words = ("dataset", "method", "cameras", "placement", "motion")
    row.only((*words, "level", "repeat", "stand_in", "status", "metrics"), ("n_points",))
    metrics = row.inner("metrics")
    blessed = Blessed(
        dataset=row.text("dataset"),
        method=row.text("method"),
        cameras=row.text("cameras"),
        placement=row.text("placement", empty=True),
        motion=row.text("motion", empty=True),
        level=row.number("level"),
        repeat=row.count("repeat"),
        stand_in=row.flag("stand_in"),
        status=row.text("status"),
        n_points=row.count("n_points") if "n_points" in row.data else None,
        metrics={name: metrics.number(name) for name in metrics.data},
    )
    if blessed.status not in STATUSES:
        row.wrong("status", f"is {blessed.status!r}, wanted one of {', '.join(STATUSES)}")
    if metrics.data and blessed.status != OK:
        row.wrong("metrics", f"has numbers, and the status is {blessed.status}")
    if odd := [name for name in metrics.data if not name.isidentifier() or len(name) > 60]:
        row.wrong("metrics", f"has a number named {odd[0]!r}")
    if blessed.n_points is not None and blessed.metrics.get("n_wrong", 0) > blessed.n_points:
        metrics.wrong("n_wrong", f"is above the {blessed.n_points} tracks of the scene")
    return blessed
