"""Tables embedded in a Markdown document, between marks that name them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import write_text
from nrsfm.reports.formats.documents import glance, tally
from nrsfm.reports.tables.model import Table

TALLY, ANSWER = "tally", "answer"


def update_document(path: Path, tables: Sequence[Table], answer: Sequence[str] = ()) -> None:
    """Replace what a document has between ``<!-- TABLE -->`` and ``<!-- end TABLE -->`` by the table at a glance.

    ``<!-- TABLE: ours, adaptive -->`` asks for the columns of these methods alone.

    Between the marks of ``tally`` goes the number of published numbers that each table reproduces, between those of
    ``answer`` the sentences of :func:`nrsfm.reports.answer.answer`. A document with marks of either need not have the
    marks of every table.

    Raises
    ------
    UsageError
        If the document lacks a table's marks.
    """
    text = path.read_text(encoding="utf-8")
    parts = {table.name: _part(table, text) for table in tables}
    whole = {TALLY: tally(tables)} | ({ANSWER: "".join(f"- {sentence}\n" for sentence in answer)} if answer else {})
    if wanted := {name: part for name, part in whole.items() if f"<!-- {name} -->" in text}:
        parts = {name: part for name, part in parts.items() if re.search(_start(name), text)} | wanted
    for name, part in parts.items():
        starts, end = list(re.finditer(_start(name), text)), f"<!-- end {name} -->"
        if len(starts) != 1 or text.count(end) != 1 or starts[0].end() > text.index(end):
            raise UsageError(f"{path}: it must hold the line <!-- {name} --> and after it {end}, each of them once")
        text = text[: starts[0].end()] + part + text[text.index(end) :]
    write_text(path, text)


def _start(name: str) -> str:
    """The mark before a table, with the methods whose columns are wanted as its group."""
    return rf"<!-- {re.escape(name)}(?:: ([\w, ]+))? -->\n"


def _part(table: Table, text: str) -> str:
    mark = re.search(_start(table.name), text)
    if mark and mark[1]:
        table = table.of_methods([name.strip() for name in mark[1].split(",")])
    return f"{table.summary}\n\n{glance(table)}"
