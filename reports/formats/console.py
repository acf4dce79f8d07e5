"""Prints a table to the terminal: one line for each dataset and method, within 120 columns."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

from nrsfm.harness.record.text import count, number
from nrsfm.reports.layouts.table_metrics import TableMetric
from nrsfm.reports.tables.model import LEGEND, NOT_ASKED, Cell, Table, Verdict

WIDTH = 120
STYLES = {Verdict.REPRODUCED: "green", Verdict.BETTER: "cyan", Verdict.WORSE: "red", Verdict.STAND_IN: "magenta"}


def console(table: Table, target: Console | None = None) -> None:
    """Print a table, its loud notes and the reasons of its empty cells, on standard output by default.

    Lines of which no number was asked are left out.
    Plain text, 120 columns wide, where the target is no terminal.
    """
    target = target or Console()
    if not target.is_terminal:
        target = Console(file=target.file, width=WIDTH, color_system=None, highlight=False, legacy_windows=False)
    target.print(Text(f"{table.title}. {table.caption}", "bold"))
    for note in table.loud:
        target.print(Text(f"! {note}", "bold yellow"))
    target.print(_grid(table))
    for line in (*reasons(table), *(test.text for test in table.tests)):
        target.print(Text(line, "dim"))
    if table.published:
        target.print(Text(LEGEND, "dim"))
    target.print(Text(table.summary, "bold"))


def reasons(table: Table) -> list[str]:
    """Reasons that do not fit into their cells, equal ones together: ``EDSC e_MS: failed: ... (Dance+Yoga)``."""
    rows_of: dict[tuple[str, str, str], list[str]] = {}
    for row, column, cell in table.cells():
        if cell.measured is None and cell.reason != NOT_ASKED and cell.reason != _first_words(cell.reason):
            rows_of.setdefault((column.label, column.metric.label, cell.reason), []).append(row.label)
    return [f"{label} {metric}: {reason} ({', '.join(rows)})" for (label, metric, reason), rows in rows_of.items()]


def _grid(table: Table) -> Grid:
    grid = Grid(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1), header_style="bold")
    compared = bool(table.published)
    grid.add_column("Dataset", overflow="fold")
    grid.add_column("Method", no_wrap=True)
    metrics = {metric.shown: metric for metric in table.metrics}
    for metric in metrics.values():
        if compared:
            grid.add_column("paper", justify="right", style="dim", no_wrap=True)
        grid.add_column(metric.shown, justify="right", no_wrap=True)
        if compared:
            grid.add_column("", no_wrap=True)
        if metric.beside:
            grid.add_column(metric.beside, justify="right", style="dim", no_wrap=True)
        if metric.counted:
            grid.add_column("wrong", justify="right", no_wrap=True)
    for row in (*table.rows, *table.means):
        asked = {
            column.method: column.label
            for column, cell in zip(table.columns, row.cells, strict=True)
            if cell.measured is not None or cell.reason not in ("", NOT_ASKED)
        }
        for i, (method, label) in enumerate(asked.items()):
            cells = zip(table.columns, row.cells, strict=True)
            shown = {column.metric.shown: cell for column, cell in cells if column.method == method}
            line = [text for name, metric in metrics.items() for text in _texts(metric, shown.get(name), compared)]
            last = i == len(asked) - 1
            grid.add_row(Text("" if i else row.label), Text(label), *line, end_section=last)
    return grid


def _texts(metric: TableMetric, cell: Cell | None, published: bool) -> list[Text]:
    """The texts under a metric's headings; empty ones for a method that the table does not show it for."""
    if cell is None:
        return [Text("")] * (1 + 2 * published + bool(metric.beside) + metric.counted)
    line = [Text(cell.published or "")] * published
    line.append(_measured(cell))
    line += [Text(cell.verdict.symbol, STYLES.get(cell.verdict, "dim"))] * published
    if metric.beside:
        line.append(Text("" if cell.beside is None else number(cell.beside)))
    if metric.counted:
        counted = cell.wrong is not None and cell.points is not None
        line.append(Text(f"{count(cell.wrong or 0)}/{cell.points}" if counted else ""))
    return line


def _measured(cell: Cell) -> Text:
    if cell.measured is None:
        return Text(_first_words(cell.reason), "yellow")
    spread = f"±{number(cell.std, cell.digits)}×{cell.count}" if cell.std is not None else ""
    return Text(number(cell.measured, cell.digits) + spread, "bold" if cell.best else "")


def _first_words(reason: str) -> str:
    """The words before the first colon if they are short, a dash if not; the whole reason is below the table."""
    return reason.split(":")[0] if len(reason.split(":")[0]) <= 9 else "–"
