"""The verb ``report``: write tables, figures, claims and the page of experiments. Never runs a method."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from nrsfm.harness.cli.parser import Parser, group_choices

if TYPE_CHECKING:
    from nrsfm.harness.config.settings import Settings
    from nrsfm.harness.record.tracked import Answer, Tracked
    from nrsfm.reports.report import Report

REPORTED = ("table1", "table2")  # the experiments that 'nrsfm report' shows by default


def main(argv: Sequence[str]) -> int:
    """Print tables or claims and write the report; exit code 2 when a trial that a table needs is missing or failed.

    Raises
    ------
    UsageError
        If an experiment or override is unknown, or the tracker cannot be reached.
    """
    options = command_line().read(argv)
    from nrsfm.harness.config.plugins import check_choices

    overrides = [word for word in options.words if "=" in word]
    names = [word for word in options.words if "=" not in word] or list(REPORTED)
    check_choices([*overrides, *(f"experiment={name}" for name in names)])
    from nrsfm.harness.record.outcome import ABSENT, OK
    from nrsfm.reports.claims import claims
    from nrsfm.reports.formats.console import console
    from nrsfm.reports.formats.embed import update_document

    report, settings = gather(names, overrides)
    folder = options.folder or settings.output / "report"
    report.write(folder)
    if options.into:
        update_document(options.into, report.tables, report.answer)
    if options.figures:
        report.draw(folder / "figures")
    if options.claims:
        print("\n".join(report.answer), claims.text(report.judged), sep="\n\n", end="")
    elif not options.quiet:
        for table in report.tables:
            console(table)
    if options.claims or options.quiet:
        print(report.summary)
    print(f"Written to {folder}; open {folder / 'index.html'}")
    runs = [run for group in report.answers.values() for _, run in group]
    statuses = [run.outcome.status for run in runs if run]
    missing, absent = runs.count(None), statuses.count(ABSENT)
    failed = sum(status not in (OK, ABSENT) for status in statuses)
    if missing:
        unrun = [name for name, group in report.answers.items() if any(run is None for _, run in group)]
        commands = "; ".join(" ".join(["nrsfm run", f"experiment={name}", *overrides]) for name in unrun)
        print(f"{missing} trials are not run yet: {commands}", file=sys.stderr)
    if absent:
        print(f"{absent} trials lack their data; the notes say how to get them", file=sys.stderr)
    if failed:
        print(f"{failed} trials failed; the cells say why", file=sys.stderr)
    return 2 if missing or absent or failed else 0


def gather(names: Sequence[str], overrides: Sequence[str] = ()) -> tuple[Report, Settings]:
    """The report of some experiments.

    Raises
    ------
    UsageError
        If an experiment or override is unknown, or the tracker cannot be reached.
    """
    from nrsfm.harness.config.compose import configurations
    from nrsfm.harness.config.spans import Request
    from nrsfm.harness.tracking.trial_runs import Arrays, Runs, answers
    from nrsfm.reports.claims import claims
    from nrsfm.reports.report import Report

    by_experiment: dict[str, Sequence[Answer]] = {}
    runs: Runs | None = None
    with configurations(overrides):
        for name in names:
            request = Request.of([f"experiment={name}", *overrides])
            by_experiment[name], runs = answers(request, runs)
        assert runs is not None
        evidence = as_configured(runs.runs, claims.METHODS)
    return Report(by_experiment, Arrays(request.settings), evidence), request.settings


def as_configured(runs: Iterable[Tracked], methods: Iterable[str]) -> list[Tracked]:
    """Finished runs on the published scenes, on real data, of methods with the settings of ``conf/method``."""
    from nrsfm.harness.config.jobs import plain_jobs
    from nrsfm.harness.config.settings import read_plain
    from nrsfm.harness.record.outcome import OK
    from nrsfm.reports.layouts.layout import scene_words

    jobs = plain_jobs([f"method={name}"] for name in methods)
    settings = {str(trial.method["name"]): trial.method for trial, _ in map(read_plain, jobs)}
    return [
        run
        for run in runs
        if run.outcome.status == OK
        and not run.outcome.stand_in
        and run.outcome.parameters.get("method") == settings.get(run.outcome.method)
        and not run.outcome.gaps
        and not scene_words(run.outcome.parameters.get("dataset", {}))
    ]


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
    parser.offers["words"] = group_choices("experiment")
    parser.add_argument("--folder", type=Path, help="where to write; OUTPUT/report by default")
    parser.add_argument("--claims", action="store_true", help="print the paper's claims in place of the tables")
    parser.add_argument("--figures", action="store_true", help="also draw the figures: svg, pdf and png")
    parser.add_argument(
        "--into", type=Path, metavar="FILE", help="also renew the tables between <!-- TABLE --> and <!-- end TABLE -->"
    )
    parser.add_argument("--quiet", action="store_true", help="write the files, print no tables")
    return parser
