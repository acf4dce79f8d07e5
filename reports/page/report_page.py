"""The report as one standalone page: summary, claims, figures, tables, and every run behind them."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from nrsfm.harness.evaluate.matching import matched
from nrsfm.harness.evaluate.metrics import METRICS
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.tracked import Fetch, Tracked
from nrsfm.reports.answer import PAPER, PROJECT
from nrsfm.reports.claims.claims import OURS
from nrsfm.reports.claims.findings import Judged
from nrsfm.reports.figures.chart import Chart
from nrsfm.reports.figures.skeleton import stable_edges
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
    picture = _pictured(runs, fetch, _viewed(tables))
    environments = (", ".join(f"{k} {v}" for k, v in run.get("versions", {}).items()) for run in data.values())
    return render_page(
        "report",
        {"runs": data, "names": _names(), "charts": {chart.name: chart.data(blobs) for chart in charts}},
        blobs,
        tables=tables,
        charts=charts,
        judged=judged,
        paper=PAPER,
        answer=answer,
        picture=picture,
        project=PROJECT,
        versions=sorted(Counter(environments).items()),
    )


def _names() -> dict[str, str]:
    """Metric -> its name for readers, where it has one."""
    return {metric.name: metric.label for metric in METRICS if metric.label}


def _pictured(runs: Mapping[str, Tracked], fetch: Fetch, viewed: Iterable[str]) -> dict[str, str] | None:
    """A picture of the first scene of several bodies that the paper's method solved: its name and PNG in base64."""
    from nrsfm.reports.figures.animation import still

    for run in (runs[key] for key in viewed if key in runs and runs[key].outcome.method == OURS):
        arrays = fetch(run)
        if {"tracks", "structure", "labels"} <= set(arrays) and np.ptp(arrays["labels"]):
            labels = matched(arrays["labels"], arrays.get("true_labels"))
            structure = arrays.get("alignment", np.eye(3)) @ arrays["structure"]
            png = still(arrays["tracks"], structure, labels, stable_edges(structure, labels))
            scene = one_line(run.outcome.dataset.replace("_", " + "))
            return {"scene": scene, "png": base64.b64encode(png).decode()}
    return None


def _viewed(tables: Sequence[Table]) -> list[str]:
    """The first run of each cell: its repeats differ by a noise draw alone."""
    cells = [cell for table in tables for layer in table.layers for _, _, cell in layer.cells()]
    return [cell.runs[0].trial_key for cell in cells if cell.runs]
