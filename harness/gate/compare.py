"""Measured numbers against blessed or published ones, row by row."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import Any

from nrsfm.harness.gate.baseline import Baseline, Blessed, index
from nrsfm.harness.gate.comparison import Comparison, Line, State
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.text import one_line


@dataclass(frozen=True)
class Tolerance:
    """How far above its baseline a metric may lie: the largest of the three.

    Parameters
    ----------
    absolute : float
        In the metric's unit.
    relative : float
        As a share of the blessed value.
    spreads : float
        In standard deviations over the blessed draws.
    """

    absolute: float = 0.0
    relative: float = 0.0
    spreads: float = 0.0

    def slack(self, value: float, spread: float = 0.0) -> float:
        return max(self.absolute, self.relative * value, self.spreads * spread) * (1 + 1e-9) + 1e-12


BLESSED_TOLERANCES: Mapping[str, Tolerance] = MappingProxyType(
    {"n_wrong": Tolerance(absolute=1), "e_3d*": Tolerance(absolute=0.002, relative=0.05)}
)


PUBLISHED_TOLERANCES: Mapping[str, Tolerance] = MappingProxyType(
    {"n_wrong": Tolerance(absolute=1), "e_3d*": Tolerance(relative=0.1)}
)


def tolerances(config: Mapping[str, Mapping[str, Any]]) -> dict[str, Tolerance]:
    """Tolerances as the configuration gives them.

    Parameters
    ----------
    config : mapping
        Metric, or a pattern such as ``e_3d*``, -> ``absolute``, ``relative``, ``spreads``; e_ms ->
        ``tracks``, ``spreads``.

    Raises
    ------
    UsageError
        Naming the entry that is no tolerance.
    """
    found = {}
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
        found[name] = Tolerance(float(absolute), float(entry.get("relative", 0)), float(entry.get("spreads", 0)))
    return found


def compare(
    baseline: Baseline,
    outcomes: Iterable[Outcome],
    tolerances: Mapping[str, Tolerance] | None = None,
    against: str = "blessed",
) -> Comparison:
    """Hold measured outcomes against blessed or published numbers.

    Parameters
    ----------
    baseline : Baseline
        The blessed one, or that of :func:`nrsfm.reports.layouts.baseline.published`.
    outcomes : iterable of Outcome
        What was measured.
    tolerances : mapping, optional
        Metric or pattern -> Tolerance; an exact name wins over a pattern. A metric of the baseline without one
        must be there but may have any value.
    against : {"blessed", "published"}
        Published numbers exist for the paper's scenes without noise; stand-ins never compare with them.

    Returns
    -------
    Comparison
        Lines in the baseline's order, then rows and metrics that it does not have.

    Raises
    ------
    UsageError
        If two outcomes differ in settings that no baseline names, or ``against`` is neither word.
    """
    outcomes = list({outcome.key: outcome for outcome in outcomes}.values())
    if against == "published":
        chosen = tolerances or PUBLISHED_TOLERANCES
        known = {row.key for row in baseline.rows}
        outcomes = [o for o in outcomes if known & {(row := Blessed.of([o])).key, row.other}]
    elif against == "blessed":
        chosen = tolerances or BLESSED_TOLERANCES
    else:
        raise UsageError(f"compare against {one_line(against)!r}: wanted blessed or published")
    measured = index(outcomes, None)
    errors = {Blessed.of([o]).key: o.error for o in outcomes if o.status != OK}
    lines: list[Line] = []
    met = set()
    for row in sorted(baseline.rows, key=lambda r: r.key):
        found = measured.get(row.key)
        if found is None and row.other in measured and (measured[row.other].status != OK or row.status != OK):
            found = replace(measured[row.other], stand_in=row.stand_in)  # an unfinished trial may not know its data
            met.add(row.other)
        if found is not None:
            met.add(row.key)
            error = errors.get(row.key) or errors.get(row.other, "")
            lines += _row(row, found, error, chosen, complete=against == "blessed")
        elif row.other in measured:
            met.add(row.other)
            lines.append(Line(row.title, "", State.MISSING, why=_unlike(row.stand_in)))
        else:
            lines.append(Line(row.title, "", State.MISSING, why="not measured"))
    for key, found in measured.items():
        if key not in met:
            state = State.NEW if found.status == OK else State.FAILED
            lines.append(Line(found.title, "", state, why=_ended(found.status, errors.get(key, ""))))
    return Comparison("the published numbers" if against == "published" else "the blessed baseline", tuple(lines))


def _row(row: Blessed, found: Blessed, error: str, chosen: Mapping[str, Tolerance], complete: bool) -> Iterator[Line]:
    if found.status != OK:
        state = State.PASS if row.status != OK else State.FAILED
        yield Line(row.title, "status", state, why=_ended(found.status, error))
        return
    if row.status != OK:
        yield Line(row.title, "status", State.IMPROVED, why=f"was {row.status}, now ok")
        return
    if None not in (row.n_points, found.n_points) and row.n_points != found.n_points:
        why = f"the baseline has {row.n_points} tracks, measured were {found.n_points}: not the same scene"
        yield Line(row.title, "", State.MISSING, why=why)
        return
    if row.trials and len(row.trials) != len(found.trials):
        why = f"the baseline is over {len(row.trials)} draws, measured were {len(found.trials)}"
        yield Line(row.title, "", State.MISSING, why=why)
        return
    if not any(metric in found.metrics and _tolerance(chosen, metric) for metric in row.metrics):
        yield Line(row.title, "status", State.PASS)
    for metric, blessed in row.metrics.items():
        tolerance = _tolerance(chosen, metric)
        value = found.metrics.get(metric)
        if value is None:
            yield Line(row.title, metric, State.MISSING, baseline=blessed, why="no longer logged")
        elif tolerance is not None:
            slack = tolerance.slack(blessed, row.spreads.get(metric, 0.0))
            low, high = blessed - slack, blessed + slack
            state = State.REGRESSED if value > high else State.IMPROVED if value < low else State.PASS
            yield Line(row.title, metric, state, blessed, value, slack, found.n_points)
    for metric in found.metrics if complete else ():
        if metric not in row.metrics and metric in chosen:
            yield Line(row.title, metric, State.NEW, measured=found.metrics[metric])


def _tolerance(chosen: Mapping[str, Tolerance], metric: str) -> Tolerance | None:
    if metric in chosen:
        return chosen[metric]
    return next((t for pattern, t in chosen.items() if fnmatchcase(metric, pattern)), None)


def _unlike(stand_in: bool) -> str:
    wanted, got = ("a stand-in", "real data") if stand_in else ("real data", "a stand-in")
    return f"the baseline is from {wanted}, measured was {got}: they do not compare"


def _ended(status: str, error: str) -> str:
    error = one_line(error)
    return "" if status == OK else f"{status}: {error}" if error else status
