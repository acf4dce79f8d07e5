"""The notes of a table: its setting, the meaning of its columns, and warnings that change how to read it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from nrsfm.harness.record.environment import COMPUTES, MACHINE, STATE
from nrsfm.harness.record.outcome import ABSENT, OK, Outcome
from nrsfm.harness.record.parameters import flatten
from nrsfm.harness.record.text import one_line
from nrsfm.reports.layouts.layout import Layout
from nrsfm.reports.layouts.table_metrics import TableMetric
from nrsfm.reports.tables.grid import Grid
from nrsfm.reports.tables.model import Column, Note, Row

NOT_SETTINGS = ("name", "bodies", "scene", "file", "placement", "motion", "repeat", "level", "source")
"""Keys of a configuration that are printed elsewhere in the table, or only locate data."""

STAND_IN = (
    "Rows marked (stand-in): procedural stand-in: the real sequence was not found. They are measured on generated "
    "data, get no verdict and say nothing about the published numbers beside them."
)


def remarks(design: Layout, columns: tuple[Column, ...], rows: tuple[Row, ...], answers: Grid) -> tuple[Note, ...]:
    """All notes of a table, loud ones first."""
    notes = [*_warnings(design, columns, rows, answers), *_settings(columns, answers)]
    metrics = dict.fromkeys(column.metric for column in columns)
    meanings = (text for metric in metrics for text in _meaning(metric, bool(design.source)))
    notes += [Note(text) for text in dict.fromkeys(meanings)]
    notes.append(Note("Bold: the lowest of its row as printed, ties too."))
    if any(cell.std is not None for row in rows for cell in row.cells):
        notes.append(Note("Repeated runs: mean ± sample standard deviation, × their number."))
    notes += [Note(text) for text in design.notes]
    return tuple(sorted(notes, key=lambda note: not note.loud))


def _warnings(design: Layout, columns: tuple[Column, ...], rows: tuple[Row, ...], answers: Grid) -> Iterator[Note]:
    if any(row.stand_in for row in rows):
        yield Note(STAND_IN, loud=True)
    runs = [run.outcome for cells in answers.rows.values() for group in cells.values() for _, run in group if run]
    for error in dict.fromkeys(outcome.error for outcome in runs if outcome.status == ABSENT):
        yield Note(f"Absent: {one_line(error, 300)}.", loud=True)
    if len(answers.settings) > 1:
        yield Note(
            "The rows are not all measured under one setting; each names its own.",
            loud=bool(design.source) and not design.study,
        )
    yield from _environments({outcome.key: outcome for outcome in runs if outcome.status == OK})
    alike: dict[str, list[str]] = {}
    for method, label in dict.fromkeys((column.method, column.label) for column in columns):
        places = zip(rows, answers.rows.values(), strict=True)  # rows are in the order of the grid
        groups = [(row.label, _flat(trial.method)) for row, cells in places for trial, _ in cells.get(method, [])]
        if differences := _differing(groups):
            alike.setdefault("; ".join(differences), []).append(label)
    for settings, labels in alike.items():
        yield Note(f"{'; '.join(labels)}: NOT ONE SETTING FOR ALL ROWS: {settings}.", loud=True)


def _environments(runs: Mapping[str, Outcome]) -> Iterator[Note]:
    """A note on the environment fields in which runs differ; a field that a record lacks is no difference."""
    fields: dict[str, Counter[str]] = {}
    for outcome in runs.values():
        environment = dict(outcome.environment)
        for package in filter(None, environment.pop("packages", "").split(", ")):
            name, _, rest = package.partition(" ")
            environment[f"package {name}"] = rest
        for name, value in environment.items():
            if name in (*MACHINE, *COMPUTES, *STATE) or name.startswith("package "):
                fields.setdefault(name, Counter())[one_line(value[:12] if name == "commit" else value, 60)] += 1
    differ = {one_line(name, 60): values for name, values in fields.items() if len(values) > 1}
    if differ:
        words = (f"{k} = {' | '.join(f'{v} ({n})' for v, n in c.items())}" for k, c in differ.items())
        yield Note(
            f"Not all runs are of one environment: {'; '.join(words)}. Times and memory compare within one alone; "
            "'nrsfm run rerun=stale' repeats what other code or libraries computed.",
            loud=bool(differ.keys() - set(STATE)),
        )


def _settings(columns: tuple[Column, ...], answers: Grid) -> Iterator[Note]:
    """Notes on the settings, scenes, cameras and noise that the rows share, and each method's parameters."""
    trials = [trial for cells in answers.rows.values() for group in cells.values() for trial, _ in group]
    if len(answers.settings) == 1 and trials:
        yield Note(f"Setting: {answers.settings[0].words()}.")
    for title, name in (("Scenes", "dataset"), ("Cameras", "cameras"), ("Noise", "noise")):
        if shared := _shared([_flat(getattr(trial, name)) for trial in trials]):
            yield Note(f"{title}: {shared}.")
    for method, label in dict.fromkeys((column.method, column.label) for column in columns):
        groups = [_flat(trial.method) for cells in answers.rows.values() for trial, _ in cells.get(method, [])]
        if shared := _shared(groups):
            yield Note(f"{label}: {shared}.")


def _meaning(metric: TableMetric, published: bool) -> Iterator[str]:
    """What the number of a metric is, and when it counts as reproduced."""
    if metric.beside and metric.metric.remark:
        yield metric.metric.remark
    if metric.distance:
        return  # the caption explains it
    if metric.pool:
        yield f"{metric.label} is the {metric.pool} of {metric.logged} over the datasets of a row, in per cent."
    if published and metric.percent:
        yield f"{metric.label} is reproduced within {metric.tolerance:g} percentage points of the published number."
    elif published and metric.counts:
        yield (
            f"{metric.label} is reproduced within {metric.tolerance:g} track of the published share, taken as a whole "
            "number of tracks; differences are in tracks."
        )
    elif published:
        yield (
            f"{metric.label} is reproduced within {100 * metric.tolerance:g} % of the published number; differences "
            "are in per cent of it."
        )


def _flat(group: Mapping[str, Any]) -> dict[str, str]:
    """Settings by dotted name, as text, without :data:`NOT_SETTINGS`."""
    return {
        one_line(path, 60): one_line("none" if value is None else value, 60)
        for path, value in flatten(group).items()
        if not (name := path.rpartition(".")[2]).startswith("_") and name not in NOT_SETTINGS
    }


def _differing(groups: list[tuple[str, dict[str, str]]]) -> list[str]:
    """``rank = 3 (Dance+Yoga) | 5 (7 rows)`` for every setting that is not the same on all rows."""
    differences = []
    for name in dict.fromkeys(name for _, group in groups for name in group):
        rows: dict[str, dict[str, None]] = {}
        for label, group in groups:
            rows.setdefault(group.get(name, "unset"), {})[label] = None
        if len(rows) > 1:
            places = {v: ", ".join(where) if len(where) < 4 else f"{len(where)} rows" for v, where in rows.items()}
            differences.append(f"{name} = " + " | ".join(f"{value} ({where})" for value, where in places.items()))
    return differences


def _shared(groups: list[dict[str, str]]) -> str:
    """``rank = 3, share = 0.7``: the settings that all groups have alike."""
    if not groups:
        return ""
    return ", ".join(f"{k} = {v}" for k, v in groups[0].items() if all(group.get(k) == v for group in groups))
