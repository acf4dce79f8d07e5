"""A table as Markdown, LaTeX and HTML, and the list of all formats; the same table gives the same bytes.

The template engine escapes all text, such as names and error messages, unless it is
:class:`~nrsfm.harness.record.text.Safe`.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from nrsfm.harness.record import text
from nrsfm.reports.formats.records import csv_text, json_text
from nrsfm.reports.layouts.table_metrics import TableMetric
from nrsfm.reports.tables.model import LEGEND, Cell, Column, Row, Table, Verdict


def markdown(table: Table) -> str:
    """GitHub Markdown: the table at a glance, then every cell with its run."""
    return _render(_MARKDOWN, "table.md.j2", table)


def glance(table: Table) -> str:
    """The table at a glance in GitHub Markdown, for a document."""
    return _render(_MARKDOWN, "glance.md.j2", table)


def tally(tables: Sequence[Table]) -> str:
    """How many published numbers each table reproduces, in GitHub Markdown; studies claim nothing and are left out."""
    return _MARKDOWN.get_template("tally.md.j2").render(tables=[table for table in tables if not table.study])


def tex_paper(table: Table) -> str:
    """The paper's columns, rows and names, measured numbers alone (booktabs, multirow)."""
    columns = [i for i, column in enumerate(table.columns) if column.heading] or list(range(len(table.columns)))
    printed = [row for row in table.rows if row.printed] or list(table.rows)
    groups = itertools.groupby((table.columns[i] for i in columns), key=lambda column: (column.heading, column.label))
    heads = [(text.Safe(heading) if heading else label, len(list(group))) for (heading, label), group in groups]
    starts = itertools.accumulate((n for _, n in heads), initial=2)
    return _render(
        _TEX,
        "paper.tex.j2",
        table,
        heads=heads,
        rules=[text.Safe(rf"\cmidrule(lr){{{a}-{a + n - 1}}}") for a, (_, n) in zip(starts, heads, strict=False)],
        columns=[table.columns[i] for i in columns],
        body=[(row.label, [row.cells[i] for i in columns]) for row in printed],
    )


def tex_audit(table: Table) -> str:
    """Published beside measured, wrong tracks and verdict: one longtable a metric (booktabs, longtable)."""
    return _render(_TEX, "audit.tex.j2", table)


def html(table: Table) -> str:
    """The table as a page of its own that loads nothing from elsewhere, light and dark."""
    return _render(HTML, "table_page.html.j2", table, page=False)


FORMATS: Mapping[str, Callable[[Table], str]] = MappingProxyType(
    {
        ".md": markdown,
        "_paper.tex": tex_paper,
        "_audit.tex": tex_audit,
        ".html": html,
        ".csv": csv_text,
        ".json": json_text,
    }
)
"""The files of each table: the end of the name, and the function that renders it."""


def measured(cell: Cell) -> str:
    """``0.0318``, or ``0.0318 ± 0.0021 × 5`` for repeated runs; a dash for none."""
    if cell.measured is None:
        return "–"
    repeated = f" ± {text.number(cell.std, cell.digits)} × {cell.count}" if cell.std is not None else ""
    return text.number(cell.measured, cell.digits) + repeated


def aside(cell: Cell, symbol: bool = True) -> str:
    """The text after a measured number at a glance: `` (0.0456) ↓ 7/116``."""
    parts = [f"({cell.published})"] if cell.published is not None else []
    if cell.measured is not None:
        parts += [cell.verdict.symbol] * (symbol and cell.published is not None) + [wrong(cell)]
    return "".join(f" {word}" for word in parts if word)


def verdict(cell: Cell, mean: bool = False) -> str:
    """The verdict, with its reason where there is one; for a mean, the number of its rows."""
    if mean:
        return cell.reason
    return f"{cell.verdict.text}: {cell.reason}" if cell.reason else cell.verdict.text


def linked(cell: Cell) -> Markup:
    """The measured number as a link to its run, where that has an address."""
    address = cell.runs[0].link if len(cell.runs) == 1 else ""
    return Markup('<a href="{}">{}</a>').format(address, measured(cell)) if address else escape(measured(cell))


def wrong(cell: Cell) -> str:
    """Wrong tracks as counts, ``7/116``."""
    return "" if cell.wrong is None or cell.points is None else f"{text.count(cell.wrong)}/{cell.points}"


def difference(cell: Cell, column: Column) -> str:
    """From the published number: ``+4`` tracks, ``-3.2 %``."""
    return "" if cell.difference is None else text.signed(cell.difference, column.metric.unit)


def source(cell: Cell) -> str:
    """The runs and trials behind a cell."""
    return "; ".join(f"run {run.run_id or '–'}, trial {run.trial_key}" for run in cell.runs)


def _groups(table: Table, metric: TableMetric) -> list[tuple[Row, list[tuple[Column, Cell]]]]:
    """The cells of one metric, row by row."""
    return [
        (row, [(c, cell) for c, cell in zip(table.columns, row.cells, strict=True) if c.metric == metric])
        for row in (*table.rows, *table.means)
    ]


def _caption(table: Table) -> text.Safe:
    """The caption as LaTeX, metrics as the paper sets them."""
    caption = text.escape_tex(table.caption)
    for metric in table.metrics:
        caption = caption.replace(text.escape_tex(metric.label), metric.tex)
    return text.Safe(caption)


def _label(metric: TableMetric) -> Markup:
    """``e_3D`` with its index set low."""
    head, mark, rest = metric.label.partition("_")
    index = re.match(r"\w*", rest).group() if mark else ""  # type: ignore[union-attr]
    return Markup("{}<sub>{}</sub>{}").format(head, index, rest[len(index) :]) if index else escape(metric.label)


def _identifier(name: str) -> text.Safe:
    """A name as it may stand in a LaTeX label."""
    return text.Safe("".join(c if c.isascii() and c.isalnum() else "-" for c in name))


def _environment(**syntax: Any) -> Environment:
    environment = Environment(
        loader=PackageLoader("nrsfm.reports"),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=StrictUndefined,
        **syntax,
    )
    environment.globals |= {"LEGEND": LEGEND, "Verdict": Verdict, "zip": zip, "groups": _groups}
    for each in (measured, linked, aside, verdict, wrong, difference, source, text.number, text.one_line):
        environment.filters[each.__name__] = each
    environment.filters |= {"tex_caption": _caption, "html_label": _label, "identifier": _identifier}
    environment.filters["tex"] = environment.filters["trusted"] = text.Safe  # text of templates and layouts
    return environment


HTML = _environment(autoescape=True)
"""The template engine for HTML with the filters that print a cell."""
_MARKDOWN = _environment(finalize=text.escape_md)

_TEX = _environment(
    finalize=text.escape_tex,
    variable_start_string="<<",
    variable_end_string=">>",
    block_start_string="<%",
    block_end_string="%>",
    comment_start_string="<#",
    comment_end_string="#>",
)


def _render(environment: Environment, template: str, table: Table, **more: Any) -> str:
    return environment.get_template(template).render(table=table, **more)
