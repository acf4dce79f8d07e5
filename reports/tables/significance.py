"""Paired tests of the paper's method against the others: Wilcoxon's signed-rank test with Holm's correction."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nrsfm.reports.tables.model import Column, Paired, Row, Setting

OURS = "ours"
FEWEST = 5
"""With fewer rows no outcome could be significant."""
EXACT = 12
"""Up to so many rows the p-value is exact: every assignment of signs is counted, ties and zeros too."""


def paired_tests(columns: Sequence[Column], rows: Sequence[Row]) -> tuple[Paired, ...]:
    """The paper's method against every other, metric by metric, over the rows of one setting where both have a number.

    The p-values of one metric and setting are corrected together (Holm 1979). Stand-ins take no part.
    """
    settings: dict[Setting, list[Row]] = {}
    for row in rows:
        if not row.stand_in:
            settings.setdefault(row.setting, []).append(row)
    tests: list[Paired] = []
    for setting, members in settings.items():
        words = setting.words(("cameras", "level")) if len(settings) > 1 else ""
        for metric in dict.fromkeys(column.metric for column in columns):
            tests += holm(_family([c for c in columns if c.metric == metric], columns, members, words))
    return tuple(tests)


def _family(
    compared: Sequence[Column], columns: Sequence[Column], rows: Sequence[Row], setting: str
) -> Iterator[Paired]:
    places = {column.method: columns.index(column) for column in compared}
    if OURS not in places:
        return
    for column in compared:
        if column.method == OURS:
            continue
        pairs = [(row.cells[places[OURS]].measured, row.cells[places[column.method]].measured) for row in rows]
        differences = np.array([ours - other for ours, other in pairs if ours is not None and other is not None])
        if len(differences) < FEWEST:
            continue
        yield Paired(
            method=column.method,
            label=column.label,
            metric=column.metric.label,
            setting=setting,
            rows=len(differences),
            better=int((differences < 0).sum()),
            worse=int((differences > 0).sum()),
            median=float(np.median(differences)),
            p=signed_rank(differences),
        )


def signed_rank(differences: NDArray[np.float64]) -> float:
    """Two-sided p-value of Wilcoxon's signed-rank test, zeros by Pratt's rule; exact for :data:`EXACT` rows and fewer.

    Parameters
    ----------
    differences : (n,) array
    """
    from scipy.stats import PermutationMethod, wilcoxon

    if not differences.any():
        return 1.0
    method = PermutationMethod(n_resamples=np.inf) if len(differences) <= EXACT else "asymptotic"
    return float(min(1.0, wilcoxon(differences, zero_method="pratt", method=method).pvalue))


def holm(family: Iterable[Paired]) -> list[Paired]:
    """A family of tests with p-values corrected by Holm's step-down rule, in the order given."""
    tests = list(family)
    p = np.array([test.p for test in tests])
    order = np.argsort(p, kind="stable")
    corrected = np.empty(len(p))
    corrected[order] = np.minimum(1, np.maximum.accumulate(np.arange(len(p), 0, -1) * p[order]))
    return [replace(test, corrected=float(value)) for test, value in zip(tests, corrected, strict=True)]
