"""A table as data: one flat record a cell, as CSV and JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import pandas as pd

from nrsfm.reports.tables.model import Row, Table

SCHEMA = 3

#: The fields of a metric in the JSON of a table.
METRIC = ("name", "label", "tex", "logged", "beside", "counts", "tolerance", "absent", "pool", "percent")


def records(table: Table) -> Iterator[dict[str, Any]]:
    """One flat record for each row, method and metric; absent values are None."""
    for row, column, cell in table.cells():
        metric = column.metric
        yield {
            "table": table.name,
            "dataset": row.dataset,
            "label": row.label,
            **asdict(row.setting),
            "stand_in": cell.stand_in,
            "method": column.method,
            "method_label": column.label,
            "metric": metric.name,
            "pool": metric.pool or None,
            "published": cell.published,
            "measured_metric": metric.logged,
            "measured": cell.measured,
            "std": cell.std,
            "runs": cell.count,
            "beside_metric": metric.beside or None,
            "beside": cell.beside,
            "wrong_tracks": cell.wrong,
            "tracks": cell.points,
            "difference": cell.difference,
            "difference_unit": metric.unit,
            "verdict": str(cell.verdict),
            "reason": cell.reason,
            "best": cell.best,
            "best_of_paper": cell.best_printed,
            "run_id": [run.run_id for run in cell.runs],
            "trial_key": [run.trial_key for run in cell.runs],
            "link": [run.link for run in cell.runs],
        }


def csv_text(table: Table) -> str:
    """The records of a table and its parts, one a line.

    Absent values are empty, true and false in small letters, lists joined by spaces.
    """
    rows = [{k: _field(v) for k, v in record.items()} for layer in table.layers for record in records(layer)]
    return pd.DataFrame(rows, dtype=object).to_csv(index=False, lineterminator="\n")


def json_text(table: Table) -> str:
    """The whole table: columns, rows, the records of its cells, means, notes and tests."""
    return json.dumps({"schema": SCHEMA} | _data(table), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _data(table: Table) -> dict[str, Any]:
    return {
        "name": table.name,
        "title": table.title,
        "caption": table.caption,
        "summary": table.summary,
        "notes": [asdict(note) for note in table.notes],
        "columns": [asdict(c) | {"metric": {name: getattr(c.metric, name) for name in METRIC}} for c in table.columns],
        "rows": [_row(row) for row in table.rows],
        "cells": list(records(table)),
        "means": [_row(row) | {"cells": [asdict(cell) for cell in row.cells]} for row in table.means],
        "parts": _data(table.parts) if table.parts else None,
        "study": table.study,
        "literature": asdict(table.literature) if table.literature else None,
        "tests": [asdict(test) for test in table.tests],
    }


def _row(row: Row) -> dict[str, Any]:
    plain = {name: getattr(row, name) for name in ("dataset", "label", "stand_in", "printed")}
    return plain | {"setting": asdict(row.setting)}


def _field(value: Any) -> Any:
    if isinstance(value, bool):
        return str(value).lower()
    return " ".join(value) if isinstance(value, list) else value
