"""A table as data: one flat record a cell, as CSV and JSON, and back."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from dataclasses import asdict, fields
from typing import Any

from nrsfm.reports.layouts.layout import Metric
from nrsfm.reports.tables.model import Cell, Column, Note, Paired, Row, Run, Setting, Table, Verdict

SCHEMA = 3


def records(table: Table) -> Iterator[dict[str, Any]]:
    """One flat record for each row, method and metric, then those of the parts; absent values are None."""
    for layer in table.layers:
        yield from _records(layer)


def _records(table: Table) -> Iterator[dict[str, Any]]:
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
    """:func:`records`, one a line; absent values empty, true and false in small letters, lists joined by spaces."""
    out = io.StringIO()
    rows = list(records(table))
    writer = csv.DictWriter(out, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: _field(value) for name, value in row.items()})
    return out.getvalue()


def json_text(table: Table) -> str:
    """The whole table; :func:`from_json` gives it back."""
    return json.dumps({"schema": SCHEMA} | _data(table), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _data(table: Table) -> dict[str, Any]:
    return {
        "name": table.name,
        "title": table.title,
        "caption": table.caption,
        "summary": table.summary,
        "notes": [asdict(note) for note in table.notes],
        "columns": [asdict(column) for column in table.columns],
        "rows": [_row_data(row) for row in table.rows],
        "cells": list(_records(table)),
        "means": [_row_data(row) | {"cells": [asdict(cell) for cell in row.cells]} for row in table.means],
        "parts": _data(table.parts) if table.parts else None,
        "study": table.study,
        "tests": [asdict(test) for test in table.tests],
    }


def from_json(source: str) -> Table:
    """The table that :func:`json_text` wrote.

    Raises
    ------
    ValueError
        If the text is not such a table.
    """
    try:
        data = json.loads(source)
        if data["schema"] != SCHEMA:
            raise ValueError(f"schema {data['schema']}, wanted {SCHEMA}")
        return _table(data)
    except (KeyError, TypeError, StopIteration, RuntimeError) as error:
        raise ValueError(f"not a table: {error!r}") from None


def _table(data: dict[str, Any]) -> Table:
    columns = tuple(Column(**{**column, "metric": Metric(**column["metric"])}) for column in data["columns"])
    cells = iter(data["cells"])
    rows = tuple(_row(row, [_cell(next(cells), column.metric.digits) for column in columns]) for row in data["rows"])
    means = tuple(_row(row, [_mean(cell) for cell in row["cells"]]) for row in data["means"])
    notes = tuple(Note(**note) for note in data["notes"])
    parts = _table(data["parts"]) if data.get("parts") else None
    tests = tuple(Paired(**test) for test in data["tests"])
    return Table(data["name"], data["title"], data["caption"], columns, rows, means, notes, parts, data["study"], tests)


def _row_data(row: Row) -> dict[str, Any]:
    return {f.name: getattr(row, f.name) for f in fields(row) if f.name not in ("cells", "setting")} | {
        "setting": asdict(row.setting)
    }


def _row(data: dict[str, Any], cells: list[Cell]) -> Row:
    return Row(**{**data, "setting": Setting(**data["setting"]), "cells": tuple(cells)})


def _mean(data: dict[str, Any]) -> Cell:
    return Cell(**{**data, "verdict": Verdict(data["verdict"]), "runs": ()})


def _cell(record: dict[str, Any], digits: int) -> Cell:
    runs = zip(record["run_id"], record["trial_key"], record["link"], strict=True)
    return Cell(
        published=record["published"],
        measured=record["measured"],
        std=record["std"],
        count=record["runs"],
        beside=record["beside"],
        wrong=record["wrong_tracks"],
        points=record["tracks"],
        difference=record["difference"],
        verdict=Verdict(record["verdict"]),
        reason=record["reason"],
        best=record["best"],
        best_printed=record["best_of_paper"],
        stand_in=record["stand_in"],
        runs=tuple(Run(*run) for run in runs),
        digits=digits,
    )


def _field(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return " ".join(value)
    return "" if value is None else str(value)
