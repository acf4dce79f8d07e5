"""A table as data: rows, columns, cells, notes and tests. Every format is written from it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from urllib.parse import quote, urlsplit, urlunsplit

from nrsfm.harness.record.text import DIGITS, one_line
from nrsfm.reports.layouts.table_metrics import TableMetric


class Verdict(StrEnum):
    """The verdict of a measured number on the published one. Better and worse are both not reproduced."""

    REPRODUCED = "reproduced"
    BETTER = "better"
    WORSE = "worse"
    NONE = "n/a"
    STAND_IN = "stand-in"

    @property
    def text(self) -> str:
        return f"not reproduced ({self})" if self in (Verdict.BETTER, Verdict.WORSE) else str(self)

    @property
    def symbol(self) -> str:
        """One character; an arrow down is an error below the published one."""
        return {"reproduced": "✓", "better": "↓", "worse": "↑", "stand-in": "◇"}.get(self, "○")


NOT_ASKED = "not asked"
"""The reason of a cell that no trial was asked for."""

LEGEND = ", ".join(f"{v.symbol} {v.text}" for v in Verdict)


@dataclass(frozen=True)
class Setting:
    """The setting of a row: what the rows of a table have in common or differ in. "" where columns differ in it."""

    cameras: str = "known"
    placement: str = "paper"
    motion: str = "registered"
    scene: str = ""  #: other settings of the scene that are not the defaults
    level: float = 0.0  #: noise, as a share of the largest image coordinate
    gaps: str = ""  #: observations dropped: kind and share
    corruption: str = ""  #: outliers, jumps, zoom: kinds and amounts
    observations: str = ""  #: how the tracks are cleaned before the method
    bodies: int | str | None = None  #: number of clusters, or "auto", where it is not the scene's number of bodies

    def words(self, names: tuple[str, ...] = ()) -> str:
        """``cameras known, placement paper, ...``: all fields, or those with the given names."""
        parts = []
        for name, value in vars(self).items():
            if names and name not in names:
                continue
            if name == "level":
                parts.append(f"noise {value:g}" if value else "no noise")
            elif name == "gaps" and names and not value:
                parts.append("no gaps")
            elif name == "corruption" and names and not value:
                parts.append("as tracked")
            elif value not in (None, ""):
                parts.append(value if name in ("scene", "corruption", "observations") else f"{name} {value}")
        return ", ".join(parts)

    @property
    def unusual(self) -> str:
        """:meth:`words` of the fields that are not the defaults."""
        names = tuple(f.name for f in fields(self) if getattr(self, f.name) not in (f.default, ""))
        return self.words(names) if names else ""


@dataclass(frozen=True)
class Run:
    """The source of a number: the tracker's run, the trial, and the run's address on a tracking server."""

    run_id: str
    trial_key: str
    link: str = ""

    @classmethod
    def at(cls, uri: str, run_id: str, trial_key: str) -> Run:
        """A run in the store at ``uri``, with a link if that is a server; the link never holds its password."""
        run_id, trial_key = one_line(run_id), one_line(trial_key)
        try:
            parts = urlsplit(uri)
        except ValueError:
            parts = urlsplit("")
        if parts.scheme not in ("http", "https") or not parts.hostname:
            return cls(run_id, trial_key)
        home = urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path.rstrip("/"), "", ""))
        return cls(run_id, trial_key, f"{home}/#/runs/{quote(run_id, safe='')}")


@dataclass(frozen=True)
class Cell:
    """The number of one method for one metric in one row."""

    published: str | None = None  #: as printed; in rows of means, the mean of the printed numbers
    measured: float | None = None  #: mean of the runs
    std: float | None = None  #: sample standard deviation of two runs and more
    count: int = 0  #: number of runs
    beside: float | None = None  #: the metric's second measured number
    wrong: float | None = None  #: wrong tracks
    points: int | None = None  #: all tracks
    difference: float | None = None  #: measured minus published, in the metric's unit
    verdict: Verdict = Verdict.NONE
    reason: str = ""  #: why there is no number, or no verdict
    best: bool = False  #: best of the row, ties too
    best_printed: bool = False  #: best among the paper's columns
    stand_in: bool = False  #: measured on generated data
    runs: tuple[Run, ...] = ()  #: behind the number; for rows that pool datasets they are in the table's parts
    digits: int = DIGITS  #: decimals that are printed


@dataclass(frozen=True)
class Column:
    """One metric of one method, by its key in the layout. ``heading`` is its LaTeX head in the paper's table, or ""."""

    method: str
    label: str
    heading: str
    metric: TableMetric


@dataclass(frozen=True)
class Row:
    """One dataset under one setting; ``cells`` run parallel to the table's columns."""

    dataset: str
    label: str
    setting: Setting
    stand_in: bool
    printed: bool
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class Note:
    """A line under the table. A loud note changes how to read the numbers and is printed above the table."""

    text: str
    loud: bool = False


@dataclass(frozen=True)
class Printed:
    """Numbers that other papers print for a table's rows, as they print them; None where there is none."""

    caption: str
    methods: tuple[str, ...]  #: labels of the columns
    rows: tuple[tuple[str, tuple[str | None, ...]], ...]  #: (label, numbers)


@dataclass(frozen=True)
class Paired:
    """The paper's method against another one over the rows of a table, by Wilcoxon's signed-rank test."""

    method: str  #: the other method
    label: str
    metric: str  #: the error compared
    setting: str  #: what the rows share, where the table holds several settings
    rows: int  #: compared
    better: int  #: rows on which the paper's method is lower
    worse: int  #: rows on which the paper's method is higher
    median: float  #: of the paper's method minus the other, in the table's numbers
    p: float  #: two-sided
    corrected: float = 1.0  #: for the other tests of the same metric and setting

    @property
    def text(self) -> str:
        """``e_MS, ours against EDSC: lower on 6 of 8, higher on 0, median difference -0.1250, p = 0.031, ...``."""
        where = f", {self.setting}" if self.setting else ""
        return (
            f"{self.metric}{where}, ours against {self.label}: lower on {self.better} of {self.rows}, higher on "
            f"{self.worse}, median difference {self.median:+.4f}, p = {self.p:.2g}, corrected {self.corrected:.2g}"
        )


@dataclass(frozen=True)
class Table:
    """A table with everything that its formats print; title and caption are plain text."""

    name: str  #: stem of its files
    title: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]  #: ``rows[i].cells[j]`` belongs to ``columns[j]``
    means: tuple[Row, ...]  #: column means, one row for each kind of data and setting
    notes: tuple[Note, ...]  #: loud ones first
    parts: Table | None = None  #: for rows that pool datasets: the same answers with a row for each dataset
    study: bool = False  #: whether the columns are candidates, which claim to reproduce nothing
    literature: Printed | None = None  #: what other papers print
    tests: tuple[Paired, ...] = ()  #: the paper's method against each other over the rows

    @property
    def layers(self) -> tuple[Table, ...]:
        """The table and, where its rows pool datasets, its parts."""
        return (self, self.parts) if self.parts else (self,)

    def of_methods(self, names: Collection[str]) -> Table:
        """The columns of some methods alone."""
        places = [i for i, column in enumerate(self.columns) if column.method in names]

        def chosen(rows: tuple[Row, ...]) -> tuple[Row, ...]:
            return tuple(replace(row, cells=tuple(row.cells[i] for i in places)) for row in rows)

        columns = tuple(self.columns[i] for i in places)
        less = replace(self, literature=None, parts=None, tests=())
        return replace(less, columns=columns, rows=chosen(self.rows), means=chosen(self.means))

    @property
    def metrics(self) -> tuple[TableMetric, ...]:
        return tuple(dict.fromkeys(column.metric for column in self.columns))

    @property
    def methods(self) -> Mapping[str, tuple[Column, ...]]:
        """The columns of every method, left to right."""
        names = dict.fromkeys(column.method for column in self.columns)
        return {name: tuple(column for column in self.columns if column.method == name) for name in names}

    @property
    def printed(self) -> bool:
        """Whether a paper prints this table."""
        return any(column.heading for column in self.columns)

    @property
    def loud(self) -> tuple[str, ...]:
        return tuple(note.text for note in self.notes if note.loud)

    def cells(self) -> Iterator[tuple[Row, Column, Cell]]:
        """Every cell, row by row, without the means."""
        for row in self.rows:
            for column, cell in zip(self.columns, row.cells, strict=True):
                yield row, column, cell

    @property
    def verdicts(self) -> Counter[Verdict]:
        """Number of cells by verdict."""
        return Counter(cell.verdict for _, _, cell in self.cells())

    @property
    def counts(self) -> tuple[int, int, int, int, int]:
        """Published numbers: all, reproduced, better, worse, not judged."""
        reproduced, better, worse = (self.verdicts[v] for v in (Verdict.REPRODUCED, Verdict.BETTER, Verdict.WORSE))
        return self.published, reproduced, better, worse, self.published - reproduced - better - worse

    @property
    def published(self) -> int:
        """Number of cells with a published number."""
        return sum(cell.published is not None for _, _, cell in self.cells())

    @property
    def summary(self) -> str:
        """One line: how many published numbers were reproduced, not reproduced, and not judged."""
        cells = [cell for _, _, cell in self.cells()]
        printed, reproduced, better, worse, rest = self.counts
        if not printed:
            words = "no published numbers"
        elif self.study:
            words = f"{reproduced} of {printed} candidates' numbers as published"
        else:
            words = f"{reproduced} of {printed} published numbers reproduced, {better + worse} not ({better} better, "
            words += f"{worse} worse), {rest} not judged"
        words += f", {sum(cell.measured is not None for cell in cells)} of {len(cells)} cells measured"
        if stand_ins := sum(cell.stand_in and cell.measured is not None for cell in cells):
            words += f", {stand_ins} of them on stand-ins and not compared"
        return f"{self.title}: {words}."
