"""The numbers that the papers print, as printed: ``reports/paper/*.csv``, read and never written.

A printed number stays a string: 0.025 and 0.0259 are the same 3 of 116 tracks in two tables of one paper.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from types import MappingProxyType

from nrsfm.harness.record.errors import UsageError


@dataclass(frozen=True)
class Source:
    """The layout of one file of published numbers."""

    file: str  #: name in ``reports/paper``
    row: str = "dataset"  #: the column that names the dataset
    metric: str = ""  #: long files: the column that names the metric
    value: str = ""  #: long files: the column that holds the number
    metrics: Mapping[str, str] = field(default_factory=dict)  #: wide files: metric -> its column
    methods: tuple[str, ...] = ()  #: files with a column a method; every number is then ``metric``
    points: str = ""  #: the column with the number of tracks, where there is one


_BOTH = MappingProxyType({"e_3d": "e_3d", "e_ms": "e_ms"})

SOURCES: Mapping[str, Source] = MappingProxyType(
    {
        "table1": Source("table1_segmentation.csv", metric="metric", value="printed", points="points"),
        "table2": Source("table2_baselines.csv", metrics=_BOTH),
        "table3": Source("table3_umpm.csv", metrics=_BOTH),
        "table4": Source("table4_dense.csv", metrics={"e_3d": "e_3d"}, points="points_published"),
        "single_body": Source("single_body.csv", row="sequence", metric="metric", value="value", points="points"),
        "three_bodies": Source("three_bodies.csv", metric="metric", value="printed"),
        "pairs_followup": Source("pairs_followup.csv", metric="e_3d", methods=("pnd", "zhu", "spatio_temporal_2017")),
        "umpm_followup": Source("umpm_followup.csv", metric="e_3d", methods=("pnd", "zhu", "spatio_temporal_2017")),
        "single_body_literature": Source("single_body_literature.csv", row="sequence", metrics={"e_3d": "value"}),
        "dense_literature": Source("dense_literature.csv", metrics={"e_3d": "e_3d"}),
        "hopkins155": Source("hopkins155.csv", "motions", metrics={m: f"{m}_percent" for m in ("mean", "median")}),
    }
)


def printed(table: str, dataset: str, method: str, metric: str) -> str | None:
    """The number as the paper prints it, or None where it prints none, e.g. of table1, dance_yoga, ssc2d and e_ms.

    Raises
    ------
    UsageError
        If there is no such table of published numbers.
    """
    return _numbers(table).get((dataset, method, metric))


def datasets(table: str) -> tuple[str, ...]:
    """The rows of a printed table, in the paper's order."""
    return tuple(dict.fromkeys(dataset for dataset, _, _ in _numbers(table)))


def methods(table: str) -> tuple[str, ...]:
    """The methods of a printed table, in the paper's order."""
    return tuple(dict.fromkeys(method for _, method, _ in _numbers(table)))


def points(table: str, dataset: str) -> int | None:
    """How many tracks the published number was measured on, where its file says so."""
    source = _source(table)
    counts = (row[source.points] for row in _rows(source.file) if source.points and row[source.row] == dataset)
    text = next(counts, "")
    return int(text) if text else None


def _source(table: str) -> Source:
    try:
        return SOURCES[table]
    except KeyError:
        raise UsageError(f"no published table {table!r}; there are {', '.join(SOURCES)}") from None


@cache
def _rows(file: str) -> tuple[dict[str, str], ...]:
    text = files("nrsfm.reports.paper").joinpath(file).read_text(encoding="utf-8")
    return tuple(csv.DictReader(text.splitlines()))


@cache
def _numbers(table: str) -> Mapping[tuple[str, str, str], str]:
    """Every number of a table by (dataset, method, metric), in the file's order."""
    source = _source(table)
    numbers: dict[tuple[str, str, str], str] = {}
    for row in _rows(source.file):
        for method, metric, text in _entries(source, row):
            key = (row[source.row], method, metric)
            if key in numbers or not math.isfinite(float(text)):
                raise ValueError(f"{source.file}: {' '.join(key)} stands twice or is no number")
            numbers[key] = text
    return MappingProxyType(numbers)


def _entries(source: Source, row: Mapping[str, str]) -> Iterator[tuple[str, str, str]]:
    """(method, metric, number) of one line."""
    for method in source.methods:
        yield method, source.metric, row[method]
    for metric, column in source.metrics.items():
        yield row["method"], metric, row[column]
    if source.value:
        yield row["method"], row[source.metric], row[source.value]
