"""Writes the tables of experiments into one folder. Never runs a method."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from harness.answers import answers
from harness.arguments import Parser
from harness.record import ABSENT, OK, UsageError
from harness.storage import ARRAYS, unpack, write_atomically
from reports.tables import Answer, Table, build
from reports.writers import FORMATS, console, glance, tally


def tables(answers_by_table: Mapping[str, Sequence[Answer]]) -> list[Table]:
    """One table for each experiment, in the order given.

    Parameters
    ----------
    answers_by_table : mapping
        Experiment -> what was asked and the run that answers it, None where none does.
    """
    return [build(name, answers) for name, answers in answers_by_table.items()]


def summary(built: Sequence[Table]) -> str:
    """One line a table: how many published numbers were reproduced."""
    return "\n".join(table.summary for table in built)


def write(answers_by_table: Mapping[str, Sequence[Answer]], folder: Path) -> list[Path]:
    """Write every format of every table; the paper's own LaTeX layout where a paper prints the table.

    Everything is rendered before anything is written, and each file appears whole or not at all.

    Parameters
    ----------
    answers_by_table : mapping
        As for :func:`tables`.
    folder : Path
        Made if it is missing. Files of other names in it are left alone.

    Returns
    -------
    list of Path
        The files, table by table.

    Raises
    ------
    UsageError
        If the folder cannot be written to, or a table's name cannot be a file's.
    """
    texts = {
        f"{table.name}{ending}": writer(table)
        for table in tables(answers_by_table)
        for ending, writer in FORMATS.items()
        if table.printed or ending != "_paper.tex"
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            _write(folder / name, text)
    except OSError as error:
        raise UsageError(f"cannot write the report to {folder}: {error.strerror}; choose another folder") from None
    return [folder / name for name in texts]


def _write(path: Path, text: str) -> None:
    write_atomically(path, lambda handle: handle.write(text.encode()))


def draw(answers_by_table: Mapping[str, Sequence[Answer]], trials: Path, folder: Path) -> list[Path]:
    """One figure a finished trial that gave a structure: image, reconstruction, affinity."""
    from reports.figures import overview, save

    written = []
    for run in {run.run_id: run for group in answers_by_table.values() for _, run in group if run}.values():
        path = trials / run.outcome.key / ARRAYS
        if "e_3d" not in run.outcome.metrics or not path.is_file():
            continue
        with np.load(path, allow_pickle=False) as stored:
            figure = overview(unpack(stored), run.outcome)
        noise = f"_noise{run.outcome.level:g}_{run.outcome.repeat}" if run.outcome.level else ""
        written.append(folder / f"{run.outcome.dataset}_{run.outcome.method}{noise}.png")
        save(figure, written[-1])
    return written


def draw_scaling(asked: Sequence[Answer], trials: Path, folder: Path) -> list[Path]:
    """The figure of the experiment ``scaling``: one point a finished trial that kept its curves."""
    from reports.figures import save
    from reports.scaling import measured, scaling

    found = []
    for outcome in (run.outcome for _, run in asked if run):
        path = trials / outcome.key / ARRAYS
        if outcome.status != OK or not path.is_file():
            continue
        with np.load(path, allow_pickle=False) as stored:
            seconds, operations = (stored[f"history_{name}"].tolist() for name in ("seconds", "operations"))
        found.append(
            measured(outcome.n_points or 0, outcome.n_frames or 0, seconds, operations, outcome.peak_mb or 0.0)
        )
    if not found:
        return []
    save(scaling(found), folder / "scaling.png")
    return [folder / "scaling.png"]


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
    write_atomically(path, lambda handle: handle.write(text.encode()))


DEFAULT = ("table1", "table2")


def main(argv: Sequence[str]) -> int:
    """Print tables and write them; exit code 2 when a trial that a table asks for is missing or failed.

    Raises
    ------
    UsageError
        If an experiment or override is unknown, or the tracker cannot be reached.
    """
    parser = Parser(
        "harness report",
        description="Rebuild tables from the tracker: md, tex (as in the paper, and for audit), html, csv, json.",
        epilog="harness report\nharness report table1 dataset.motion=native 'dataset.placement=[3,0,0]'",
    )
    parser.add_argument(
        "words", nargs="*", metavar="TABLE|OVERRIDE", help=f"experiments ({' '.join(DEFAULT)}) and overrides"
    )
    parser.add_argument("--folder", type=Path, help="where to write; OUTPUT/report by default")
    parser.add_argument("--figures", action="store_true", help="also draw every trial that gave a structure")
    parser.add_argument(
        "--into", type=Path, metavar="FILE", help="also renew the tables between <!-- TABLE --> and <!-- end TABLE -->"
    )
    parser.add_argument("--quiet", action="store_true", help="write the files, print no tables")
    given = parser.read(argv)
    names = [word for word in given.words if "=" not in word] or list(DEFAULT)
    overrides = [word for word in given.words if "=" in word]
    found: dict[str, list[Answer]] = {}
    settings = None
    for name in names:
        found[name], settings = answers([f"+experiment={name}", *overrides])
    assert settings is not None
    built = tables(found)
    if not given.quiet:
        for table in built:
            console(table)
    folder = given.folder or settings.output / "report"
    write(found, folder)
    if given.into:
        renew(given.into, built)
    if given.figures:
        draw({name: group for name, group in found.items() if name != "scaling"}, settings.trials, folder / "figures")
        draw_scaling(found.get("scaling", []), settings.trials, folder / "figures")
    print(summary(built))
    print(f"Written to {folder}")
    lacking = [trial for group in found.values() for trial, run in group if run is None]
    ended = [run.outcome.status for group in found.values() for _, run in group if run]
    absent, failed = ended.count(ABSENT), sum(status not in (OK, ABSENT) for status in ended)
    if lacking:
        print(f"{len(lacking)} trials are not run yet; 'harness run +experiment=...' runs them", file=sys.stderr)
    if absent:
        print(f"{absent} trials lack their data; the notes say how to get them", file=sys.stderr)
    if failed:
        print(f"{failed} trials failed; the cells say why", file=sys.stderr)
    return 2 if lacking or absent or failed else 0
