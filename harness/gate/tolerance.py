"""Tolerances: how far above its baseline a metric may lie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import Any

from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.text import one_line


@dataclass(frozen=True)
class Tolerance:
    """How far above its baseline a metric may lie: the largest of three amounts.

    They are in the metric's unit, as a share of the blessed value, and in standard deviations over the blessed draws.
    """

    absolute: float = 0.0
    relative: float = 0.0
    spreads: float = 0.0

    def slack(self, value: float, spread: float = 0.0) -> float:
        """The amount for a baseline's value and spread, widened by rounding errors."""
        return max(self.absolute, self.relative * value, self.spreads * spread) * (1 + 1e-9) + 1e-12


#: Against a blessed baseline.
BLESSED_TOLERANCES: Mapping[str, Tolerance] = MappingProxyType(
    {"n_wrong": Tolerance(absolute=1), "e_3d*": Tolerance(absolute=0.002, relative=0.05)}
)

#: Against the paper's numbers.
PUBLISHED_TOLERANCES: Mapping[str, Tolerance] = MappingProxyType(
    {"n_wrong": Tolerance(absolute=1), "e_3d*": Tolerance(relative=0.1)}
)


def tolerances(config: Mapping[str, Mapping[str, Any]]) -> dict[str, Tolerance]:
    """The tolerances of ``compare.tolerances`` in the configuration, by metric or pattern such as ``e_3d*``.

    An entry has ``absolute``, ``relative``, ``spreads``; that of ``e_ms``, which becomes ``n_wrong``, ``tracks`` and
    ``spreads``. UsageError names the entry that is not a tolerance.
    """
    read = {}
    if not isinstance(config, Mapping):
        raise UsageError(f"compare.tolerances is {config!r}, wanted metrics with their tolerances")
    for metric, entry in config.items():
        allowed = ("tracks", "spreads") if metric in ("e_ms", "n_wrong") else ("absolute", "relative", "spreads")
        if not isinstance(entry, Mapping) or not entry or not set(entry) <= set(allowed):
            raise UsageError(f"tolerance of {one_line(metric)}: wanted {' and '.join(allowed)}")
        for name, value in entry.items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < float("inf"):
                raise UsageError(f"tolerance of {one_line(metric)}: {name} is {value!r}, wanted a number >= 0")
        name = "n_wrong" if "tracks" in allowed else metric
        absolute = entry.get("tracks", entry.get("absolute", 0))
        read[name] = Tolerance(float(absolute), float(entry.get("relative", 0)), float(entry.get("spreads", 0)))
    return read


def tolerance_of(metric: str, tolerances: Mapping[str, Tolerance]) -> Tolerance | None:
    """The tolerance of a metric: that of its exact name, else of the first pattern that fits, else None."""
    if metric in tolerances:
        return tolerances[metric]
    return next((tolerance for pattern, tolerance in tolerances.items() if fnmatchcase(metric, pattern)), None)
