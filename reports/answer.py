"""Does the paper reproduce? The answer in a few sentences, from tables and claims."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from nrsfm.harness.record.text import number
from nrsfm.reports.claims.claims import DENSE_METHODS, OURS
from nrsfm.reports.claims.findings import HELD, NOT_HELD, NOT_TESTED, Judged
from nrsfm.reports.tables.model import Cell, Column, Table, Verdict

PAPER = (
    "S. Kumar, Y. Dai, H. Li, “Multi-body Non-rigid Structure-from-Motion”, International Conference on 3D Vision "
    "(3DV) 2016, arXiv 1607.04515."
)
PROJECT = "adaptive"
"""This project's own method, for which no paper prints a number."""


def answer(tables: Sequence[Table], judged: Sequence[Judged]) -> tuple[str, ...]:
    """One sentence each on the paper's method, on the baselines, on this project's method and on the paper's claims.

    Studies take no part: their columns are candidates.
    """
    claiming = [table for table in tables if not table.study]
    cells = [(column, cell) for table in claiming for _, column, cell in table.cells() if cell.published is not None]
    ours = [cell for column, cell in cells if column.method in (OURS, *DENSE_METHODS)]
    rest = [cell for column, cell in cells if column.method not in (OURS, *DENSE_METHODS)]
    sentences = [f"The paper's method as printed: {_counts(ours)}."] * bool(ours)
    sentences += [f"The baselines: {_counts(rest)}."] * bool(rest)
    if beside := "; ".join(filter(None, map(_project, claiming))):
        sentences.append(f"This project's method (adaptive), of which nothing is published: {beside}.")
    return (*sentences, *([_claims(judged)] if judged else []))


def _counts(cells: Sequence[Cell]) -> str:
    """``18 of 24 published numbers are reproduced; 2 measured better, 3 worse, 1 not judged``."""
    better, worse, reproduced = (
        sum(cell.verdict is verdict for cell in cells)
        for verdict in (Verdict.BETTER, Verdict.WORSE, Verdict.REPRODUCED)
    )
    words = f"{reproduced} of {len(cells)} published numbers are reproduced; {better} measured better, {worse} worse"
    rest = len(cells) - reproduced - better - worse
    return words + f", {rest} not judged" * bool(rest)


def _project(table: Table) -> str:
    """This project's mean errors beside what the paper prints for its own method, over the rows of one table."""
    phrases = []
    for metric in table.metrics:
        for row in table.means:
            own, paper = (_cell(table, row.cells, method, metric.label) for method in (PROJECT, OURS))
            if own is None or paper is None or own.measured is None or paper.published is None or row.stand_in:
                continue
            phrases.append(f"mean {metric.label} {number(own.measured)} (printed for the paper's {paper.published})")
    return f"{table.title}: " + ", ".join(phrases) if phrases else ""


def _cell(table: Table, cells: Sequence[Cell], method: str, metric: str) -> Cell | None:
    places: Iterator[tuple[Column, Cell]] = zip(table.columns, cells, strict=True)
    return next((cell for column, cell in places if (column.method, column.metric.label) == (method, metric)), None)


def _claims(judged: Sequence[Judged]) -> str:
    """``Of the paper's 10 claims 3 hold, 2 do not and 5 are not tested (`nrsfm run experiment=table3` tests them).``"""
    held, against, open_ = ([c for c in judged if c.verdict == v] for v in (HELD, NOT_HELD, NOT_TESTED))
    words = f"Of the paper's {len(judged)} claims {_verb(len(held), 'holds', 'hold')}, "
    words += _verb(len(against), "does not", "do not")
    if not open_:
        return words + "."
    commands = "; ".join(dict.fromkeys(f"nrsfm run experiment={claim.experiment}" for claim in open_))
    return f"{words} and {_verb(len(open_), 'is', 'are')} not tested by these runs ({commands})."


def _verb(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"
