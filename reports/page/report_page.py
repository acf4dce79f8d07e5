"""The report as one standalone page: summary, claims, figures, tables, and every run behind them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from nrsfm.harness.record.tracked import Fetch, Tracked
from nrsfm.reports.answer import PAPER
from nrsfm.reports.claims.findings import Judged
from nrsfm.reports.figures.chart import Chart
from nrsfm.reports.page.runs import details
from nrsfm.reports.page.standalone import render_page
from nrsfm.reports.tables.model import Table


def page(
    tables: Sequence[Table],
    charts: Sequence[Chart],
    judged: Sequence[Judged],
    answer: Sequence[str],
    runs: Mapping[str, Tracked],
    fetch: Fetch,
) -> str:
    """The page of some tables and the runs behind them, by trial key; HTML that loads nothing from elsewhere.

    The same runs give the same text.

    Raises
    ------
    UsageError
        If plotly is not installed.
    """
    data, blobs = details(runs.values(), fetch, _viewed(tables))
    environments = (", ".join(f"{k} {v}" for k, v in run.get("versions", {}).items()) for run in data.values())
    return render_page(
        "report",
        {"runs": data, "charts": {chart.name: chart.data(blobs) for chart in charts}},
        blobs,
        tables=tables,
        charts=charts,
        judged=judged,
        paper=PAPER,
        answer=answer,
        versions=sorted(Counter(environments).items()),
    )


def _viewed(tables: Sequence[Table]) -> list[str]:
    """The first run of each cell: its repeats differ by a noise draw alone."""
    cells = [cell for table in tables for layer in table.layers for _, _, cell in layer.cells()]
    return [cell.runs[0].trial_key for cell in cells if cell.runs]
