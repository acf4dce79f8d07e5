"""Builds the table of an experiment: published and measured numbers, each with a verdict.

Errors are not computed here: numbers are logged metrics, their means over repeats, and their distance from the
published ones.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import replace

from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.outcome import ABSENT, OK
from nrsfm.harness.record.text import number, one_line
from nrsfm.harness.record.tracked import Answer, Tracked
from nrsfm.reports.layouts.baseline import wrong_tracks
from nrsfm.reports.layouts.index import layout
from nrsfm.reports.layouts.labels import method_label
from nrsfm.reports.layouts.layout import Layout, Method
from nrsfm.reports.layouts.literature import LABELS
from nrsfm.reports.layouts.table_metrics import DISTANCES, MEANS, TableMetric
from nrsfm.reports.tables.grid import Grid, RowKey, grid, repeats
from nrsfm.reports.tables.model import NOT_ASKED, Cell, Column, Printed, Row, Run, Setting, Table, Verdict
from nrsfm.reports.tables.overall import COLUMNS, overall
from nrsfm.reports.tables.remarks import remarks
from nrsfm.reports.tables.significance import paired_tests


def build(name: str, answers: Sequence[Answer], design: Layout | None = None) -> Table:
    """The table of an experiment.

    Parameters
    ----------
    name : str
        The experiment: selects the layout, and is the stem of the table's files.
    answers : sequence of (Trial, Tracked or None)
        The trials of the experiment, and the run that answers each; None if no run does.
    design : Layout, optional
        Replaces the experiment's own layout.

    Returns
    -------
    Table
        The paper's rows in its order, with trials or without, then the others. Methods that the layout does not have
        get columns on the right.

    Raises
    ------
    UsageError
        If the name cannot be a file name.
    """
    if not name or not name.replace("_", "").replace("-", "").isalnum():
        raise UsageError(f"table name {one_line(name)!r} holds more than letters, digits, - and _")
    design = design or layout(name)
    sorted_answers = grid(answers, design)
    places = _columns(design, sorted_answers)
    columns = tuple(column for _, column in places)
    rows = tuple(_row(design, places, sorted_answers, key) for key in sorted_answers.rows)
    if design.judges:
        judges = [build(name, answers, judge) for judge in design.judges]
        rows = tuple(replace(row, cells=overall(judges, row) + row.cells) for row in rows)
        columns = COLUMNS + columns
    notes = remarks(design, columns, rows, sorted_answers)
    means = () if design.pools else _means(rows, columns)
    parts = build(name, answers, design.parts) if design.parts else None
    tests = () if design.pools or design.study else paired_tests(columns, rows)
    printed = _literature(design, rows)
    return Table(name, design.title, design.caption, columns, rows, means, notes, parts, design.study, printed, tests)


def _literature(design: Layout, rows: Sequence[Row]) -> Printed | None:
    """The other papers' numbers for the datasets of the rows, and their means where every row has one."""
    if design.literature is None:
        return None
    labels = {row.dataset: design.label(row.dataset) for row in rows}
    values = {dataset: design.literature.values(dataset) for dataset in labels}
    lines = [(labels[dataset], numbers) for dataset, numbers in values.items() if any(numbers)]
    if len(lines) > 1:
        columns = list(zip(*(numbers for _, numbers in lines), strict=True))
        means = (
            number(statistics.fmean(map(float, filter(None, column)))) if all(column) else None for column in columns
        )
        lines.append(("Mean", tuple(means)))
    return Printed(design.literature.caption, tuple(LABELS[m] for m in design.literature.methods), tuple(lines))


Place = tuple[Method, Column]


def _columns(design: Layout, answers: Grid) -> list[Place]:
    """Columns with their methods: the paper's always, all others only where there are trials of them."""
    present = {method.key for method in answers.methods}
    methods = [method for method in design.methods if method.heading or method.key in present]
    methods += [method for method in answers.methods if method not in methods]
    return [
        (method, Column(method.key, method.label or method_label(method.name), method.heading, metric))
        for method in methods
        for metric in method.metrics or design.metrics
    ]


def _row(design: Layout, places: Sequence[Place], answers: Grid, key: RowKey) -> Row:
    label = design.label(key.dataset) or key.setting.unusual or "as by default"
    differing = _differing(answers.settings)
    if differing and design.label(key.dataset):
        label += f", {key.setting.words(differing)}"
    if key.stand_in:
        label += " (stand-in)"
    cells = [_cell(design, *place, key, answers.rows[key].get(place[0].key, [])) for place in places]
    marked = _mark(tuple(column for _, column in places), cells)
    return Row(key.dataset, label, key.setting, key.stand_in, key.dataset in design.datasets, marked)


def _differing(settings: Iterable[Setting]) -> tuple[str, ...]:
    """The fields in which settings differ."""
    distinct = set(settings)
    return tuple(name for name in Setting.__match_args__ if len({getattr(s, name) for s in distinct}) > 1)


def _cell(design: Layout, method: Method, column: Column, key: RowKey, answers: Sequence[Answer]) -> Cell:
    metric, pool = column.metric, design.pools.get(key.dataset)
    published = None if metric.distance else design.printed(key.dataset, method, metric)
    blank = Cell(published=published, stand_in=key.stand_in, digits=metric.digits)
    if not answers:
        return replace(blank, reason=NOT_ASKED)
    groups = repeats(answers, pooled=pool is not None)
    group = groups[0]
    runs = [run for _, run in group if run is not None]
    if pool is None:
        blank = replace(blank, runs=tuple(Run.at(r.uri, r.run_id, r.outcome.key) for r in runs))
    if len(groups) > 1:
        return replace(blank, runs=(), reason=f"{len(groups)} settings of this method were asked; a cell holds one")
    values = [
        r.outcome.metrics[metric.logged] for r in runs if r.outcome.status == OK and metric.logged in r.outcome.metrics
    ]
    missing = next(filter(None, (_missing(run, metric) for _, run in group)), "")
    if not values:
        return replace(blank, beside=_mean(runs, metric.beside), reason=missing)
    if metric.distance:
        return _distance_cell(blank, design, method, metric, group, key)
    points = {r.outcome.n_points for r in runs if r.outcome.status == OK}
    middle = MEANS[metric.pool or "mean"](values)
    cell = replace(
        blank,
        measured=100 * middle if metric.percent else middle,
        std=statistics.stdev(values) if len(values) > 1 and pool is None else None,
        count=len(values),
        beside=_mean(runs, metric.beside),
        wrong=_mean(runs, metric.counts),
        points=points.pop() if len(points) == 1 else None,
    )
    if key.setting.scene and cell.published is not None and not design.study:
        missing = f"another scene than the published one: {key.setting.scene}"
    if len(values) < len(group):
        missing = f"{len(group) - len(values)} of {len(group)} runs without a number ({missing})"
    elif pool and (asked := len({trial.dataset["name"] for trial, _ in group})) < len(pool.datasets):
        missing = f"over {asked} of {len(pool.datasets)} datasets"
    return _judge(cell, metric, key.setting, design.published_points(key.dataset), missing)


def _distance_cell(
    blank: Cell, design: Layout, method: Method, metric: TableMetric, group: Sequence[Answer], key: RowKey
) -> Cell:
    """A cell with the distance between the runs of a pool and the published numbers of its datasets."""
    pairs: list[tuple[float, float]] = []
    for trial, run in group:
        printed = design.printed(trial.dataset["name"], method, metric)
        if run is None or printed is None or metric.logged not in run.outcome.metrics:
            continue
        counted = run.outcome.metrics.get(metric.counts)
        if counted is None:
            pairs.append((run.outcome.metrics[metric.logged], float(printed)))
        else:
            pairs.append((counted, wrong_tracks(float(printed), run.outcome.n_points or 0)))
    if blank.stand_in:
        return replace(blank, reason="generated data, of which nothing is published")
    whole = len(design.pools[key.dataset].datasets) if key.dataset in design.pools else 1
    if len(pairs) < whole:
        return replace(blank, reason=f"{len(pairs)} of {whole} datasets have a number and a published one")
    return replace(blank, measured=DISTANCES[metric.pool][0](pairs), count=whole, reason=f"over {whole} datasets")


def _judge(cell: Cell, metric: TableMetric, setting: Setting, published_points: int | None, missing: str) -> Cell:
    """The cell with its verdict, or with the reason why it has none."""
    if cell.stand_in:
        return replace(cell, verdict=Verdict.STAND_IN, reason=missing)
    if missing:
        return replace(cell, reason=missing)
    if cell.published is None:
        return replace(cell, reason="no published number")
    if setting.level:
        return replace(cell, reason="noise added; the published number is without")
    if setting.corruption:
        return replace(cell, reason="tracks corrupted; the published number is without")
    if setting.gaps:
        return replace(cell, reason="observations dropped; the published number is without")
    if metric.counts and (cell.wrong is None or not cell.points):
        return replace(cell, reason=f"{metric.counts} or n_points not logged")
    if published_points and cell.points and cell.points != published_points:
        return replace(cell, reason=f"measured on {cell.points} tracks, published on {published_points}")
    published = float(cell.published)
    if metric.counts:
        distance, scale = (cell.wrong or 0.0) - wrong_tracks(published, cell.points or 0), 1.0
    else:
        distance, scale = (cell.measured or 0.0) - published, 1.0 if metric.percent else published
    slack = metric.tolerance * scale + 1e-12
    worse = distance > 0 if metric.metric.better == "lower" else distance < 0
    verdict = Verdict.REPRODUCED if abs(distance) <= slack else Verdict.WORSE if worse else Verdict.BETTER
    return replace(cell, difference=distance / scale if scale else None, verdict=verdict)


def _missing(run: Tracked | None, metric: TableMetric) -> str:
    """Why a run has no number; "" if it has one."""
    if run is None:
        return "not run"
    outcome = run.outcome
    if outcome.status == ABSENT:
        return ABSENT
    if outcome.status != OK:
        error = one_line(outcome.error)
        return f"{outcome.status}: {error}" if error else outcome.status
    if metric.logged in outcome.metrics:
        return ""
    return f"{metric.logged} not logged" if metric.beside in outcome.metrics else metric.absent


def _mean(runs: Sequence[Tracked], name: str) -> float | None:
    values = [r.outcome.metrics[name] for r in runs if r.outcome.status == OK and name in r.outcome.metrics]
    return statistics.fmean(values) if values else None


def _mark(columns: tuple[Column, ...], cells: list[Cell]) -> tuple[Cell, ...]:
    """Mark the best number of each metric in a row, ties at the printed precision too; a lone number is not marked.

    Distances from published numbers are not marked: they rank the rows.
    """
    marked = list(cells)
    for metric in dict.fromkeys(column.metric for column in columns if not column.metric.distance):
        places = [i for i, column in enumerate(columns) if column.metric == metric]
        for i in _best(cells, places, metric):
            marked[i] = replace(marked[i], best=True)
        for i in _best(cells, [i for i in places if columns[i].heading], metric):
            marked[i] = replace(marked[i], best_printed=True)
    return tuple(marked)


def _best(cells: Sequence[Cell], places: Sequence[int], metric: TableMetric) -> list[int]:
    """Places of the best cells; none for a metric in which no number is better, or for a lone number."""
    choose = {"lower": min, "higher": max}.get(metric.metric.better)
    values = {i: round(cell.measured, cell.digits) for i in places if (cell := cells[i]).measured is not None}
    if choose is None or len(values) < 2:
        return []
    return [i for i, value in values.items() if value == choose(values.values())]


def _means(rows: tuple[Row, ...], columns: tuple[Column, ...]) -> tuple[Row, ...]:
    """A row of column means for each kind of data and setting.

    The mean is over the rows in which every measured column has a number, so that columns compare; at least two rows.
    """
    kinds: dict[tuple[bool, Setting], list[Row]] = {}
    for row in rows:
        kinds.setdefault((row.stand_in, row.setting), []).append(row)
    means = []
    for (stand_in, setting), members in kinds.items():
        used = [i for i in range(len(columns)) if any(row.cells[i].measured is not None for row in members)]
        common = [row for row in members if all(row.cells[i].measured is not None for i in used)]
        if not used or len(common) < 2:
            continue
        cells = tuple(_mean_cell([row.cells[i] for row in common], stand_in) for i in range(len(columns)))
        label = "Mean" if len(common) == len(members) else f"Mean ({len(common)} of {len(members)} rows)"
        differing = _differing(s for _, s in kinds)
        label += f", {setting.words(differing)}" if differing else ""
        means.append(Row("mean", label + " (stand-in)" * stand_in, setting, stand_in, False, cells))
    return tuple(means)


def _mean_cell(cells: Sequence[Cell], stand_in: bool) -> Cell:
    measured, published, beside, wrong, points = (
        [value for cell in cells if (value := getattr(cell, name)) is not None]
        for name in ("measured", "published", "beside", "wrong", "points")
    )
    if not measured:
        return Cell(reason="no row measured", stand_in=stand_in)
    whole = len(cells)
    return Cell(
        published=number(statistics.fmean(map(float, published))) if len(published) == whole and not stand_in else None,
        measured=statistics.fmean(measured),
        count=whole,
        beside=statistics.fmean(beside) if len(beside) == whole else None,
        wrong=sum(wrong) if len(wrong) == whole else None,
        points=sum(points) if len(points) == whole else None,
        reason=f"over {whole} rows",
        stand_in=stand_in,
    )
