"""The metrics that tables show: which logged number answers which published one, and how rows pool it."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from nrsfm.harness.evaluate.metric_type import Metric
from nrsfm.harness.evaluate.metrics import BY_NAME
from nrsfm.harness.record.text import DIGITS

Pairs = Sequence[tuple[float, float]]
"""Measured and published numbers of the datasets of a pool."""


def _rms_log_ratio(pairs: Pairs) -> float:
    return math.sqrt(statistics.fmean(math.log(max(m, 1e-300) / p) ** 2 for m, p in pairs))


def _tracks(pairs: Pairs) -> float:
    return sum(abs(m - p) for m, p in pairs)


#: Pools of measured numbers.
MEANS: Mapping[str, Callable[[Sequence[float]], float]] = MappingProxyType(
    {"mean": statistics.fmean, "median": statistics.median}
)

#: Pools of measured and published numbers: the distance, 0 at best, and the decimals that are printed.
DISTANCES: Mapping[str, tuple[Callable[[Pairs], float], int]] = MappingProxyType(
    {"log ratio": (_rms_log_ratio, 3), "tracks off": (_tracks, 0)}
)

#: Figures over all published numbers of some tables, see :mod:`nrsfm.reports.tables.overall`, and their decimals.
OVERALL: Mapping[str, int] = MappingProxyType({"as printed": 0, "difference": 3})


@dataclass(frozen=True)
class TableMetric:
    """A metric as the columns of a table show it."""

    logged: str  #: the logged metric, a key of :data:`~nrsfm.harness.evaluate.metrics.BY_NAME`
    published: str = ""  #: its name in ``reports/paper``; the logged name by default
    pool: str = ""
    """How a row pools its datasets' numbers, of :data:`MEANS`, :data:`DISTANCES` or :data:`OVERALL`; "" for no pool."""
    title: str = ""  #: the label; the metric's own by default

    @property
    def metric(self) -> Metric:
        """The entry of the logged metric."""
        return BY_NAME[self.logged]

    @property
    def name(self) -> str:
        """The published metric."""
        return self.published or self.logged

    @property
    def label(self) -> str:
        """For readers."""
        return (self.title or self.metric.label or self.logged) + " %" * self.percent

    @property
    def tex(self) -> str:
        """The label as LaTeX."""
        return (self.title or self.metric.tex or self.metric.label or self.logged) + r" (\%)" * self.percent

    @property
    def distance(self) -> bool:
        """Whether it compares with the published numbers; nothing is published of that."""
        return self.pool in DISTANCES or self.pool in OVERALL

    @property
    def percent(self) -> bool:
        """Whether it is printed in per cent of the logged share."""
        return self.pool in MEANS and self.metric.unit == "share"

    @property
    def beside(self) -> str:
        """A second logged metric that is printed next to it, or ""."""
        return "" if self.distance else self.metric.beside

    @property
    def counts(self) -> str:
        """The logged number of wrong tracks, for a share of tracks; the verdict is then taken in tracks."""
        return "" if self.percent else self.metric.counts

    @property
    def counted(self) -> bool:
        """Whether wrong tracks are printed next to the number."""
        return bool(self.counts) and not self.pool

    @property
    def tolerance(self) -> float:
        """How far from the published number still counts as reproduced, in :attr:`unit`."""
        return self.metric.pooled_tolerance if self.percent else self.metric.tolerance

    @property
    def absent(self) -> str:
        """Why a finished run may have no such number."""
        return self.metric.absent

    @property
    def unit(self) -> str:
        """The unit of differences from published numbers."""
        if self.percent:
            return "percentage points"
        return "tracks" if self.counts else "share of published"

    @property
    def digits(self) -> int:
        """Decimals that are printed."""
        if self.distance:
            return OVERALL[self.pool] if self.pool in OVERALL else DISTANCES[self.pool][1]
        return 2 if self.percent else DIGITS

    @property
    def shown(self) -> str:
        """The head of a measured column: ``e_3d_dai``, ``mean e_ms, %``."""
        return f"{self.pool} {self.logged}".strip() + ", %" * self.percent


def pooled(metric: TableMetric, pool: str = "", **changes: str) -> TableMetric:
    """A metric of rows that pool datasets, by the pool of its entry unless another is named."""
    return replace(metric, pool=pool or metric.metric.pool, **changes)


#: The paper's two errors, which a table has unless it names others.
E_3D = TableMetric("e_3d_dai", published="e_3d")
E_MS = TableMetric("e_ms")

E_R = TableMetric("e_r")
E_3D_ALIGNED = TableMetric("e_3d_dai")
E_3D_CAMERA = TableMetric("e_3d_dai_cam")
E_3D_FRAMES = TableMetric("e_3d_procrustes", title="e_3D, frames aligned")
E_3D_KNOWN = TableMetric("e_3d_dai", published="e_3d_gt_rotation")

MEAN = pooled(E_MS, published="mean", title="mean")
MEDIAN = pooled(E_MS, "median", published="median", title="median")
MEAN_TRACKS = replace(MEAN, title="wrong tracks")
MEAN_3D = pooled(E_3D)
E_3D_HIDDEN = TableMetric("e_3d_hidden")
MEAN_HIDDEN = pooled(E_3D_HIDDEN)

FOUND = TableMetric("n_bodies_found")
EIGENGAP = TableMetric("eigengap")
MISCOUNTED = pooled(TableMetric("miscounted"))
