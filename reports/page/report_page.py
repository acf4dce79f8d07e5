"""The report as one page that needs nothing else: summary, claims, figures, tables, and every run behind them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from markupsafe import Markup

from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.tracked import Fetch, Tracked
from nrsfm.reports.claims.findings import Judged
from nrsfm.reports.figures.chart import Chart
from nrsfm.reports.figures.style import COLOURS
from nrsfm.reports.formats.documents import html_environment
from nrsfm.reports.page.runs import details
from nrsfm.reports.tables.model import Table, Verdict

LIBRARY = "package_data/plotly.min.js"


def page(
    tables: Sequence[Table],
    charts: Sequence[Chart],
    judged: Sequence[Judged],
    runs: Mapping[str, Tracked],
    fetch: Fetch,
) -> str:
    """The page of some tables.

    Parameters
    ----------
    tables : sequence of Table
    charts : sequence of Chart
    judged : sequence of Judged
        The claims.
    runs : mapping
        Trial key -> the tracked run, for every run that a cell names.
    fetch : callable
        Gives the arrays of a tracked run, empty if there are none.

    Returns
    -------
    str
        HTML that loads nothing: style, scripts, plotly.js and all data stand in it. The same runs give the same text.

    Raises
    ------
    UsageError
        If plotly is not installed.
    """
    told, blobs = details(runs.values(), fetch, _viewed(tables))
    drawn = {chart.name: chart.data(blobs) for chart in charts}
    data = {"runs": told, "charts": drawn, "blobs": blobs.held, "colours": COLOURS}
    template = html_environment().get_template("report.html.j2")
    return template.render(
        page=True,
        tables=tables,
        charts=charts,
        judged=judged,
        totals=totals(tables),
        versions=_versions(told),
        data=script_json(data),
        library=Markup(plotly()),
        script=scripts("player.js", "report.js"),
    )


def totals(tables: Sequence[Table]) -> dict[str, int]:
    """Published numbers of all tables but studies by verdict; ``not judged`` for the rest."""
    claiming = [table for table in tables if not table.study]
    counts = {verdict.value: sum(t.verdicts[verdict] for t in claiming) for verdict in list(Verdict)[:3]}
    return counts | {"not judged": sum(table.published for table in claiming) - sum(counts.values())}


def script_json(data: Any) -> Markup:
    """Data as JSON that may stand in a script element: no text in it can end the element."""
    text = json.dumps(data, separators=(",", ":"), sort_keys=True, allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def scripts(*names: str) -> Markup:
    """Scripts of the templates' folder, one after the other."""
    return Markup("\n").join(
        Markup(files("nrsfm.reports.templates").joinpath(n).read_text(encoding="utf-8")) for n in names
    )


def plotly() -> str:
    """The plotly.js that the plotly package ships."""
    found = find_spec("plotly")
    if found is None or found.origin is None:
        raise UsageError("the page needs plotly; install it with 'pip install plotly'")
    return (Path(found.origin).parent / LIBRARY).read_text(encoding="utf-8")


def _viewed(tables: Sequence[Table]) -> list[str]:
    """The first run of each cell: its repeats differ by a noise draw alone."""
    cells = [cell for table in tables for layer in table.layers for _, _, cell in layer.cells()]
    return [cell.runs[0].trial_key for cell in cells if cell.runs]


def _versions(told: Mapping[str, Any]) -> list[tuple[str, int]]:
    """What the runs were computed with, and how many by each."""
    said: dict[str, int] = {}
    for run in told.values():
        words = ", ".join(f"{name} {value}" for name, value in run.get("versions", {}).items())
        said[words] = said.get(words, 0) + 1
    return sorted(said.items())
