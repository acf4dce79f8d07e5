"""The design of a table as data: its methods in columns, its rows, and where its published numbers are."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from nrsfm.harness.record.text import one_line
from nrsfm.reports.layouts import published
from nrsfm.reports.layouts.literature import Literature
from nrsfm.reports.layouts.table_metrics import E_3D, E_MS, TableMetric


@dataclass(frozen=True)
class SameAs:
    """Stands for the value of another setting of the same trial, by its dotted path."""

    path: str


@dataclass(frozen=True)
class Method:
    """A method's place in a table."""

    name: str  #: the method, as trials call it
    heading: str = ""  #: its LaTeX head in the paper's own table, "" for a column that the paper does not have
    printed: str = ""  #: its name in ``reports/paper``, where it is another one
    source: str = ""  #: its table in ``reports/paper``, where it is not the layout's
    where: Mapping[str, Any] = field(default_factory=dict)
    """Dotted setting -> value of the trials that belong here, for a method that has several columns."""
    label: str = ""  #: for readers; the method's by default
    metrics: tuple[TableMetric, ...] = ()  #: the layout's by default

    @property
    def key(self) -> str:
        """Unique in the table: ``bmm``, or ``bmm cameras.source=known``."""
        return " ".join([self.name, *(f"{k}={getattr(v, 'path', v)}" for k, v in self.where.items())])

    def holds(self, settings: Mapping[str, Any]) -> bool:
        """Whether a trial with these settings (``dataset``, ``method``, ``cameras``, ``noise``) belongs here."""
        if lookup(settings, "method.name") != self.name:
            return False
        return all(
            lookup(settings, path) == (lookup(settings, value.path) if isinstance(value, SameAs) else value)
            for path, value in self.where.items()
        )


def columns(*names: str, metrics: tuple[TableMetric, ...] = ()) -> tuple[Method, ...]:
    """Columns of methods that the paper's own table does not have."""
    return tuple(Method(name, metrics=metrics) for name in names)


def lookup(settings: Mapping[str, Any], path: str) -> Any:
    """The value of a dotted setting, None where there is none."""
    value: Any = settings
    for name in path.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return value


@dataclass(frozen=True)
class Pool:
    """A row that pools many datasets. Without a label it is named by its setting."""

    label: str
    datasets: tuple[str, ...]


@dataclass(frozen=True)
class Layout:
    """A table as its paper prints it, with the columns that this project adds; title and caption are plain text."""

    title: str
    caption: str
    methods: tuple[Method, ...] = ()  #: columns from left to right; those with a heading make the paper's table
    metrics: tuple[TableMetric, ...] = (E_3D, E_MS)  #: shown for every method that names none
    source: str = ""  #: the published table (a key of ``nrsfm.reports.layouts.published.SOURCES``), "" for none
    points: str = ""  #: the published table that says how many tracks there were, "" for none
    joiner: str = ""  #: between the names of a row's bodies; "" leaves dataset names as they are
    pools: Mapping[str, Pool] = field(default_factory=dict)
    """Row -> the datasets that it pools. A dataset may count in several rows."""
    parts: Layout | None = None  #: where rows pool datasets: the layout of the same answers, a row for each dataset
    judges: tuple[Layout, ...] = ()
    """Where rows pool datasets: tables whose published numbers a row is held against, those of all methods together."""
    study: bool = False
    """Whether the trials are candidates: they are compared with the published numbers whatever their scene, and claim
    to reproduce none."""
    notes: tuple[str, ...] = ()  #: notes that cannot be derived from the answers
    literature: Literature | None = None  #: what other papers print for the same data

    @property
    def datasets(self) -> tuple[str, ...]:
        """The paper's rows in its order."""
        return tuple(self.pools) or (published.datasets(self.source) if self.source else ())

    def method(self, settings: Mapping[str, Any]) -> Method:
        """The column of a trial with these settings; a new column for a method that the layout does not have."""
        for method in self.methods:
            if method.holds(settings):
                return method
        return Method(one_line(lookup(settings, "method.name")))

    def printed(self, dataset: str, method: Method, metric: TableMetric) -> str | None:
        """The published number, None where there is none."""
        source = method.source or self.source
        return published.printed(source, dataset, method.printed or method.name, metric.name) if source else None

    def rows(self, dataset: str) -> tuple[str, ...]:
        """The rows that a dataset counts in."""
        return tuple(row for row, pool in self.pools.items() if dataset in pool.datasets) or (dataset,)

    def published_points(self, dataset: str) -> int | None:
        return published.points(self.points, dataset) if self.points else None

    def label(self, dataset: str) -> str:
        """``dance_yoga`` as the paper writes it: ``Dance+Yoga``. Other datasets keep their names."""
        if dataset in self.pools:
            return self.pools[dataset].label
        if not self.joiner or dataset not in self.datasets:
            return dataset
        return self.joiner.join(body.capitalize() for body in dataset.split("_"))


#: The other settings of the published scenes; placement and motion have fields of their own in tables.
SCENE: Mapping[str, Any] = {
    "registration": "turn",
    "frames": None,
    "scale": "sequence",
    "upright": False,
    "degrees_per_frame": 5.0,
}


def scene_words(dataset: Mapping[str, Any]) -> str:
    """Settings in which a scene differs from the published one, besides placement and motion; "" for none."""
    changed = ((name, dataset[name]) for name, value in SCENE.items() if dataset.get(name, value) != value)
    return ", ".join(f"{name} {setting_text(value)}" for name, value in changed)


def setting_text(value: Any) -> str:
    """A setting's value as one line: ``paper``, ``0.5``, ``[3,0,0]``."""
    if isinstance(value, list | tuple):
        return f"[{','.join(map(setting_text, value))}]"
    if isinstance(value, float):
        return f"{value:g}"
    return one_line(value if isinstance(value, str) else json.dumps(value))
