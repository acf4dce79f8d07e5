"""Tables embedded in a Markdown document, between marks that name them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import write_text
from nrsfm.reports.formats.documents import glance, tally
from nrsfm.reports.tables.model import Table

TALLY, ANSWER = "tally", "answer"


def update_document(path: Path, tables: Sequence[Table], answer: Sequence[str] = ()) -> None:
    """Replace what a document has between ``<!-- TABLE -->`` and ``<!-- end TABLE -->`` by the table at a glance.

    Between the marks of ``tally`` goes the number of published numbers that each table reproduces, between those of
    ``answer`` the sentences of :func:`nrsfm.reports.answer.answer`. A document with marks of either need not have the
    marks of every table.

    Raises
    ------
    UsageError
        If the document lacks a table's marks.
    """
    text = path.read_text(encoding="utf-8")
    parts = {table.name: f"{table.summary}\n\n{glance(table)}" for table in tables}
    whole = {TALLY: tally(tables), ANSWER: "".join(f"- {sentence}\n" for sentence in answer)}
    if wanted := {name: part for name, part in whole.items() if f"<!-- {name} -->" in text}:
        parts = {name: part for name, part in parts.items() if f"<!-- {name} -->" in text} | wanted
    for name, part in parts.items():
        start, end = f"<!-- {name} -->\n", f"<!-- end {name} -->"
        if text.count(start) != 1 or text.count(end) != 1 or text.index(start) > text.index(end):
            raise UsageError(f"{path}: it must hold the line {start.strip()} and after it {end}, each of them once")
        head, _, rest = text.partition(start)
        text = f"{head}{start}{part}{end}{rest.partition(end)[2]}"
    write_text(path, text)
