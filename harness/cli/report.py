"""Writes tables, figures, claims and the page of experiments into one folder. Never runs a method."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from nrsfm.harness.cli.parser import Parser, _choices
from nrsfm.harness.config.compose import configurations
from nrsfm.harness.config.jobs import plain_jobs
from nrsfm.harness.config.settings import Settings, read_plain
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import write_text
from nrsfm.harness.record.outcome import ABSENT, OK
from nrsfm.harness.record.tracked import Answer, Fetch, Tracked
from nrsfm.harness.tracking.artifacts import Arrays
from nrsfm.harness.tracking.runs import Runs, answers
from nrsfm.reports.claims import claims
from nrsfm.reports.claims.findings import Evidence, Judged
from nrsfm.reports.figures.catalogue import charts
from nrsfm.reports.figures.charts import Chart
from nrsfm.reports.formats.console import console
from nrsfm.reports.formats.documents import FORMATS, glance, tally
from nrsfm.reports.layouts.layout import scene_words
from nrsfm.reports.page.report import page
from nrsfm.reports.tables.build import build
from nrsfm.reports.tables.model import Table

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
    store: Runs | None = None
    with configurations():
        for name in names:
            found[name], settings, store = answers([f"experiment={name}", *overrides], store)
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
    from nrsfm.reports.figures.overview import save

    written = []
    for name, figure in _figures(report):
        for suffix in ("svg", "pdf", "png"):
            written.append(folder / f"{name}.{suffix}")
            save(figure, written[-1])
    return written


def _figures(report: Report) -> Iterator[tuple[str, Figure]]:
    from nrsfm.reports.figures.drawing import chart_figure
    from nrsfm.reports.figures.overview import overview

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
    given = command_line().read(argv)
    names = [word for word in given.words if "=" not in word] or list(REPORTED)
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
        print(f"{len(lacking)} trials are not run yet; 'nrsfm run experiment=...' runs them", file=sys.stderr)
    if absent:
        print(f"{absent} trials lack their data; the notes say how to get them", file=sys.stderr)
    if failed:
        print(f"{failed} trials failed; the cells say why", file=sys.stderr)
    return 2 if lacking or absent or failed else 0


def as_configured(runs: Iterable[Tracked], methods: Iterable[str]) -> list[Tracked]:
    """Finished runs on the published scenes, on real data, of methods with the settings of ``conf/method``."""
    jobs = plain_jobs([f"method={name}"] for name in methods)
    wanted = {str(trial.method["name"]): trial.method for trial, _ in map(read_plain, jobs)}
    return [
        run
        for run in runs
        if run.outcome.status == OK
        and not run.outcome.stand_in
        and run.outcome.parameters.get("method") == wanted.get(run.outcome.method)
        and not run.outcome.parameters.get("gaps")
        and not scene_words(run.outcome.parameters.get("dataset", {}))
    ]


REPORTED = ("table1", "table2")  # the experiments that 'nrsfm report' shows by default


def command_line() -> Parser:
    parser = Parser(
        "nrsfm report",
        "Rebuild tables, figures and claims from what was run; no method runs. Written are index.html, the tables as "
        "md, tex (as in the paper, and for audit), html, csv and json, and the paper's claims.",
        """\
nrsfm report  # tables 1 and 2, here and in outputs/report
nrsfm report --claims  # the paper's claims, held or not
nrsfm report table1 noise convergence --figures  # figures as svg, pdf and png as well
nrsfm report table1 dataset.motion=native 'dataset.placement=[3,0,0]'
nrsfm report table1 table2 --into README.md --quiet  # renew the tables of a document""",
        "exit codes: 0 every cell has its number, 2 a trial is missing or failed, 3 usage",
    )
    parser.add_overrides("words", "TABLE|OVERRIDE", f"; or an experiment by its name ({' '.join(REPORTED)} by default)")
    parser.offers["words"] = _choices("experiment")
    parser.add_argument("--folder", type=Path, help="where to write; OUTPUT/report by default")
    parser.add_argument("--claims", action="store_true", help="print the paper's claims in place of the tables")
    parser.add_argument("--figures", action="store_true", help="also draw the figures: svg, pdf and png")
    parser.add_argument(
        "--into", type=Path, metavar="FILE", help="also renew the tables between <!-- TABLE --> and <!-- end TABLE -->"
    )
    parser.add_argument("--quiet", action="store_true", help="write the files, print no tables")
    return parser
