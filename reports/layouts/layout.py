"""The words in which a table is designed: its metrics, its methods, its rows."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from nrsfm.harness.record.text import DIGITS, one_line
from nrsfm.reports.layouts import published

Pairs = Sequence[tuple[float, float]]
"""Measured and published numbers of the datasets of a pool."""


MEANS: Mapping[str, Callable[[Sequence[float]], float]] = MappingProxyType(
    {"mean": statistics.fmean, "median": statistics.median}
)
"""What a pool makes of measured numbers."""


def _rms_log_ratio(pairs: Pairs) -> float:
    return math.sqrt(statistics.fmean(math.log(max(m, 1e-300) / p) ** 2 for m, p in pairs))


def _off(pairs: Pairs) -> float:
    return float(sum(abs(m - p) > 0.1 * p + 1e-12 for m, p in pairs))


def _tracks(pairs: Pairs) -> float:
    return float(sum(abs(m - p) for m, p in pairs))


@dataclass(frozen=True)
class Distance:
    """A function of the pairs, 0 at best, and the decimals that are printed."""

    of: Callable[[Pairs], float]
    digits: int


DISTANCES: Mapping[str, Distance] = MappingProxyType(
    {
        "log ratio": Distance(_rms_log_ratio, 3),
        "> 10 % off": Distance(_off, 0),
        "tracks off": Distance(_tracks, 0),
    }
)
"""What a pool makes of measured numbers and the published ones: how far it is from the paper."""


@dataclass(frozen=True)
class Metric:
    """One published error and the logged numbers that answer it. Lower is better.

    Parameters
    ----------
    name : str
        The published metric, as in ``reports/paper``.
    label, tex : str
        For readers, and as LaTeX.
    logged : str
        The logged metric that belongs beside the published number.
    beside : str
        A second logged metric that stands next to it, or "".
    counts : str
        The logged number of wrong tracks, for a share of tracks; the verdict is then taken in tracks.
    tolerance : float
        How far from the published number still counts as reproduced, in :attr:`unit`.
    absent : str
        Why a finished run may have no such number.
    pool : str
        What a row that pools datasets makes of their numbers: one of :data:`MEANS`, or of :data:`DISTANCES` from the
        published ones.
    percent : bool
        Printed in per cent of the logged share.
    """

    name: str
    label: str
    tex: str
    logged: str
    beside: str = ""
    counts: str = ""
    tolerance: float = 0.1
    absent: str = "not measured"
    pool: str = ""
    percent: bool = False

    @property
    def unit(self) -> str:
        """The unit of differences."""
        if self.percent:
            return "percentage points"
        return "tracks" if self.counts else "share of published"

    @property
    def counted(self) -> bool:
        """Whether wrong tracks stand beside the number."""
        return bool(self.counts) and not self.pool

    @property
    def digits(self) -> int:
        """Decimals that are printed."""
        if self.pool in DISTANCES:
            return DISTANCES[self.pool].digits
        return 2 if self.percent else DIGITS

    @property
    def shown(self) -> str:
        """What stands in a column: ``e_3d_dai``, ``mean e_ms, %``."""
        return f"{self.pool} {self.logged}".strip() + ", %" * self.percent

    def distance(self, form: str, label: str) -> Metric:
        """This metric pooled into one of :data:`DISTANCES`; nothing is published of that."""
        return replace(self, label=label, tex=label, beside="", pool=form)


E_3D = Metric("e_3d", "e_3D", "$e_{3D}$", logged="e_3d_dai", beside="e_3d", absent="method gives no structure")


E_MS = Metric("e_ms", "e_MS", "$e_{MS}$", logged="e_ms", counts="n_wrong", tolerance=1, absent="method gives no labels")
"""The paper's two errors, which a table has unless it says otherwise."""


@dataclass(frozen=True)
class SameAs:
    """In place of a setting's value: the value of the trial's setting ``path``."""

    path: str


@dataclass(frozen=True)
class Method:
    """A method's place in a table.

    Parameters
    ----------
    name : str
        The method, as trials call it.
    heading : str
        Its LaTeX head in the paper's own table, "" for a column of ours.
    printed, source : str
        Its name and its table in ``reports/paper``, where they are not the method's and the layout's.
    where : mapping
        Dotted setting -> value: the trials that belong here, where a method stands more than once.
    label : str
        For readers; the method's by default.
    metrics : tuple of Metric
        The layout's by default.
    """

    name: str
    heading: str = ""
    printed: str = ""
    source: str = ""
    where: Mapping[str, Any] = field(default_factory=dict)
    label: str = ""
    metrics: tuple[Metric, ...] = ()

    @property
    def key(self) -> str:
        """``bmm``, or ``bmm cameras.source=known``: no other column of the table is called so."""
        return " ".join([self.name, *(f"{k}={getattr(v, 'path', v)}" for k, v in self.where.items())])

    def holds(self, settings: Mapping[str, Any]) -> bool:
        """Whether a trial with these settings (``dataset``, ``method``, ``cameras``, ``noise``) belongs here."""
        if lookup(settings, "method.name") != self.name:
            return False
        return all(
            lookup(settings, path) == (lookup(settings, value.path) if isinstance(value, SameAs) else value)
            for path, value in self.where.items()
        )


def lookup(settings: Mapping[str, Any], path: str) -> Any:
    """The value of a dotted setting, None where there is none."""
    value: Any = settings
    for name in path.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return value


@dataclass(frozen=True)
class Pool:
    """A row that stands for many datasets. Without a label it is called after its setting."""

    label: str
    datasets: tuple[str, ...]


@dataclass(frozen=True)
class Layout:
    """A table as its paper prints it, and the columns that the audit adds.

    Parameters
    ----------
    title, caption : str
        Plain text.
    methods : tuple of Method
        Columns from left to right; those with a heading make the paper's table.
    metrics : tuple of Metric
        Shown for every method that names none.
    source : str
        The published table (a key of ``nrsfm.reports.layouts.published.SOURCES``), "" for none.
    points : str
        The published table that says how many tracks there were, "" for none.
    joiner : str
        Between the names of a row's bodies; "" leaves dataset names as they are.
    pools : mapping
        Printed row -> the datasets that it stands for, where that is not the dataset of its name. A dataset may
        count in several rows.
    parts : Layout or None
        Of the same answers with a row for each dataset, where rows pool them.
    study : bool
        Whether the trials are candidates, each held against the published numbers whatever its scene, and no claim to
        reproduce them.
    notes : tuple of str
        What the reader must know besides what the answers tell.
    """

    title: str
    caption: str
    methods: tuple[Method, ...] = ()
    metrics: tuple[Metric, ...] = (E_3D, E_MS)
    source: str = ""
    points: str = ""
    joiner: str = ""
    pools: Mapping[str, Pool] = field(default_factory=dict)
    parts: Layout | None = None
    study: bool = False
    notes: tuple[str, ...] = ()

    @property
    def datasets(self) -> tuple[str, ...]:
        """The paper's rows in its order."""
        return tuple(self.pools) or (published.datasets(self.source) if self.source else ())

    @property
    def told_apart(self) -> frozenset[str]:
        """The settings that tell columns apart, and so no rows."""
        return frozenset(path for method in self.methods for path in method.where)

    def method(self, settings: Mapping[str, Any]) -> Method:
        """The column of a trial; one of its own for a method that the layout did not foresee."""
        for method in self.methods:
            if method.holds(settings):
                return method
        return Method(one_line(lookup(settings, "method.name")))

    def printed(self, dataset: str, method: Method, metric: Metric) -> str | None:
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


SCENE: Mapping[str, Any] = {"frames": None, "scale": "sequence", "upright": False, "degrees_per_frame": 5.0}
"""The settings of the published scenes that have no field of their own in :class:`~nrsfm.reports.tables.model.Setting`."""


def scene_words(dataset: Mapping[str, Any]) -> str:
    """What makes a scene another than the published one, besides its placement and motion; "" for nothing."""
    changed = ((name, dataset[name]) for name, value in SCENE.items() if dataset.get(name, value) != value)
    return ", ".join(f"{name} {_word(value)}" for name, value in changed)


def _word(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{','.join(map(_word, value))}]"
    if isinstance(value, float):
        return f"{value:g}"
    return one_line(value if isinstance(value, str) else json.dumps(value))
