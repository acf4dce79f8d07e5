"""One candidate against all published numbers of some tables: how many it reproduces, and how far off it is."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from nrsfm.reports.layouts.table_metrics import OVERALL, TableMetric
from nrsfm.reports.tables.model import Cell, Column, Row, Table, Verdict

COLUMNS = tuple(Column("all", "All methods", "", TableMetric("e_ms", pool=pool, title=pool)) for pool in OVERALL)


def overall(judges: Sequence[Table], row: Row) -> tuple[Cell, ...]:
    """The cells of :data:`COLUMNS`: reproduced numbers, and the mean difference from print.

    A difference is |measured - published|, as a share of the published error or of all tracks. Only the judges' rows of
    the same setting and data count, and there is no number unless each published one has its measured one.
    """
    cells = [
        (column.metric, cell)
        for judge in judges
        for other, column, cell in judge.cells()
        if (other.setting, other.stand_in) == (row.setting, row.stand_in) and cell.published is not None
    ]
    away = [abs(cell.difference or 0) / ((cell.points or 1) if metric.counts else 1) for metric, cell in cells]
    judged = [cell for _, cell in cells if cell.verdict not in (Verdict.NONE, Verdict.STAND_IN)]
    if not cells or len(judged) < len(cells):
        return (Cell(reason=f"{len(judged)} of {len(cells)} published numbers judged", stand_in=row.stand_in),) * 2
    reproduced = sum(cell.verdict is Verdict.REPRODUCED for cell in judged)
    return tuple(
        Cell(measured=value, count=len(cells), reason=f"over {len(cells)} numbers", digits=column.metric.digits)
        for column, value in zip(COLUMNS, (float(reproduced), statistics.fmean(away)), strict=True)
    )
