"""The published numbers as a baseline of the gate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from nrsfm.harness.gate.baseline import Baseline, Blessed
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.reports.layouts.index import LAYOUTS


def published(outcomes: Sequence[Outcome]) -> Baseline:
    """The published numbers of some outcomes, as a baseline of real data without noise.

    A share of wrong tracks becomes a number of tracks, and the published e_3d is compared with e_3d_dai, which it
    follows. Outcomes without a published number have no row.
    """
    rows: dict[Any, Blessed] = {}
    for outcome in outcomes:
        row = replace(Blessed.of([outcome]), stand_in=False, status=OK, trials=())
        if outcome.level or outcome.gaps or row.key in rows:
            continue
        metrics: dict[str, float] = {}
        points = outcome.n_points
        settings = outcome.parameters | {"method": {"name": outcome.method}, "cameras": {"source": outcome.cameras}}
        for design in (layout for layout in LAYOUTS.values() if not layout.study):
            points = design.published_points(outcome.dataset) or points
            method = design.method(settings)
            for metric in method.metrics or design.metrics:
                text = design.printed(outcome.dataset, method, metric)
                if text is not None and (not metric.counts or points):
                    value = wrong_tracks(float(text), points or 0) if metric.counts else text
                    metrics.setdefault(metric.counts or metric.logged, float(value))
        if metrics:
            rows[row.key] = replace(row, n_points=points, metrics=metrics, spreads={})
    return Baseline("published numbers", "", tuple(rows.values()))


def wrong_tracks(share: float, points: int) -> int:
    """Number of tracks of a published share: .025 of 116 is 3."""
    return round(share * points)
