"""Writes tables, figures, claims and the page of experiments into one folder. Never runs a method."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from harness import parsers
from harness.answers import Store, answers
from harness.evidence import Arrays, as_configured
from harness.experiments import Settings, configurations
from harness.record import ABSENT, OK, UsageError
from harness.storage import write_text
from reports import claims
from reports.catalogue import charts
from reports.charts import Chart
from reports.findings import Evidence, Judged
from reports.grid import Tracked
from reports.page import page
from reports.runs import Fetch
from reports.tables import Answer, Table, build
from reports.writers import FORMATS, console, glance, tally

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Report:
    """The answers to some experiments, and everything that is made of them.

    Parameters
    ----------
    answers : mapping
        Experiment -> what was asked and the run that answers it, None where none does.
    fetch : callable
        Gives the arrays of a run; by default no run has any.
    evidence : sequence of Tracked
        The runs that the claims are judged by.
    """

    answers: Mapping[str, Sequence[Answer]]
    fetch: Fetch = field(default=lambda run: {})
    evidence: Sequence[Tracked] = ()

    @cached_property
    def tables(self) -> list[Table]:
        """One table for each experiment, in the order given."""
        return [build(name, found) for name, found in self.answers.items()]

    @cached_property
    def charts(self) -> list[Chart]:
        return charts(self.answers, self.fetch)

    @cached_property
    def judged(self) -> list[Judged]:
        return claims.judge(Evidence(self.evidence, self.fetch))

    @property
    def runs(self) -> dict[str, Tracked]:
        """Every run that answers, by trial key."""
        return {run.outcome.key: run for group in self.answers.values() for _, run in group if run}

    @property
    def summary(self) -> str:
        """One line a table: how many published numbers were reproduced."""
        return "\n".join(table.summary for table in self.tables)

    def texts(self) -> dict[str, str]:
        """Every file by name: each table in every format (the paper's own LaTeX layout where a paper prints it), the
        claims, and the page."""
        found = {
            f"{table.name}{ending}": writer(table)
            for table in self.tables
            for ending, writer in FORMATS.items()
            if table.printed or ending != "_paper.tex"
        }
        found["claims.json"] = (
            json.dumps(claims.data(self.judged), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        )
        found["index.html"] = page(self.tables, self.charts, self.judged, self.runs, self.fetch)
        return found


def gather(names: Sequence[str], overrides: Sequence[str] = ()) -> tuple[Report, Settings]:
    """The report of some experiments.

    Raises
    ------
    UsageError
        If an experiment or override is unknown, or the tracker cannot be reached.
    """
    found: dict[str, Sequence[Answer]] = {}
    store: Store | None = None
    with configurations():
        for name in names:
            found[name], settings, store = answers([f"+experiment={name}", *overrides], store)
        assert store is not None
        evidence = as_configured(store.runs, (*claims.OURS, *claims.BASELINES))
    return Report(found, Arrays(settings), evidence), settings


def write(report: Report, folder: Path) -> list[Path]:
    """Write :meth:`Report.texts`; everything is rendered before anything is written, each file whole or not at all.

    Parameters
    ----------
    report : Report
    folder : Path
        Made if it is missing. Files of other names in it are left alone.

    Returns
    -------
    list of Path

    Raises
    ------
    UsageError
        If the folder cannot be written to, or a table's name cannot be a file's.
    """
    texts = report.texts()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            write_text(folder / name, text)
    except OSError as error:
        raise UsageError(f"cannot write the report to {folder}: {error.strerror}; choose another folder") from None
    return [folder / name for name in texts]


def draw(report: Report, folder: Path) -> list[Path]:
    """Every chart, and a picture of each finished run that gave a structure, as svg, pdf and png."""
    from reports.figures import save

    written = []
    for name, figure in _figures(report):
        for suffix in ("svg", "pdf", "png"):
            written.append(folder / f"{name}.{suffix}")
            save(figure, written[-1])
    return written


def _figures(report: Report) -> Iterator[tuple[str, Figure]]:
    from reports.drawing import chart_figure
    from reports.figures import overview

    for chart in report.charts:
        yield chart.name, chart_figure(chart)
    drawn = set()
    for table, group in report.answers.items():
        for run in (run for _, run in group if run and "e_3d" in run.outcome.metrics):
            outcome, arrays = run.outcome, report.fetch(run)
            if outcome.key not in drawn and "tracks" in arrays:
                drawn.add(outcome.key)
                noise = f"_noise{outcome.level:g}_{outcome.repeat}" if outcome.level else ""
                yield f"{table}_{outcome.dataset}_{outcome.method}{noise}", overview(arrays, outcome)


TALLY = "tally"


def renew(path: Path, built: Sequence[Table]) -> None:
    """Write each table at a glance into a document, between ``<!-- NAME -->`` and ``<!-- end NAME -->``.

    Between the marks of ``tally`` stands how many published numbers each of the tables reproduces; a document that
    has them need not hold the tables.

    Raises
    ------
    UsageError
        If the document lacks a table's marks.
    """
    text = path.read_text(encoding="utf-8")
    parts = {table.name: f"{table.summary}\n\n{glance(table)}" for table in built}
    if f"<!-- {TALLY} -->" in text:
        parts = {name: part for name, part in parts.items() if f"<!-- {name} -->" in text}
        parts[TALLY] = tally(built)
    for name, part in parts.items():
        start, end = f"<!-- {name} -->\n", f"<!-- end {name} -->"
        if text.count(start) != 1 or text.count(end) != 1 or text.index(start) > text.index(end):
            raise UsageError(f"{path}: the line {start.strip()} and then {end} must stand in it once")
        head, _, rest = text.partition(start)
        text = f"{head}{start}{part}{end}{rest.partition(end)[2]}"
    write_text(path, text)


def main(argv: Sequence[str]) -> int:
    """Print tables or claims and write the report; exit code 2 when a trial that a table asks for is missing or failed.

    Raises
    ------
    UsageError
        If an experiment or override is unknown, or the tracker cannot be reached.
    """
    given = parsers.report().read(argv)
    names = [word for word in given.words if "=" not in word] or list(parsers.REPORTED)
    report, settings = gather(names, [word for word in given.words if "=" in word])
    if given.claims:
        print(claims.text(report.judged), end="")
    elif not given.quiet:
        for table in report.tables:
            console(table)
    folder = given.folder or settings.output / "report"
    write(report, folder)
    if given.into:
        renew(given.into, report.tables)
    if given.figures:
        draw(report, folder / "figures")
    print(report.summary)
    print(f"Written to {folder}; open {folder / 'index.html'}")
    asked = [answer for group in report.answers.values() for answer in group]
    lacking = [trial for trial, run in asked if run is None]
    ended = [run.outcome.status for _, run in asked if run]
    absent, failed = ended.count(ABSENT), sum(status not in (OK, ABSENT) for status in ended)
    if lacking:
        print(f"{len(lacking)} trials are not run yet; 'harness run +experiment=...' runs them", file=sys.stderr)
    if absent:
        print(f"{absent} trials lack their data; the notes say how to get them", file=sys.stderr)
    if failed:
        print(f"{failed} trials failed; the cells say why", file=sys.stderr)
    return 2 if lacking or absent or failed else 0
