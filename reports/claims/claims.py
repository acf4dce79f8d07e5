"""The paper's claims as data: each statement, and the rule that judges it by measured runs.

A claim about every pair holds only if every pair was measured; one counterexample refutes it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from nrsfm.harness.record.text import number
from nrsfm.reports.claims.findings import UMPM, Case, Evidence, Finding, Judged, word
from nrsfm.reports.layouts import published
from nrsfm.reports.layouts.labels import LABELS

OURS = "ours"
"""The paper's method as printed: the only one that the paper's claims are about."""
DENSE_METHODS = ("ours_c", "ours_cd")
"""The paper's method for dense tracks, without and with the neighbour term."""
METHODS = (OURS, *DENSE_METHODS, "ssc2d", "edsc", "bmm_ssc3d")
"""Every method whose runs are evidence."""
PAIRS = published.datasets("table1")
NOISY = tuple(pair for pair in PAIRS if pair != "drink_walking")
"""The seven pairs of the paper's noise experiment."""
LEVELS = (0.0, 0.01, 0.02, 0.03, 0.04, 0.05)
DENSE = published.datasets("table4")
Rule = Callable[[Evidence], Iterable[Case]]


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, and the rule that judges it."""

    experiment: str  #: whose runs judge it
    statement: str
    rule: str  #: in words
    judge: Rule
    measures: str = ""  #: names the values of the cases


def judge(evidence: Evidence) -> list[Judged]:
    """Every claim, judged by the runs of :data:`OURS`."""
    return [
        Judged(
            number, claim.statement, claim.rule, claim.experiment, Finding(tuple(claim.judge(evidence)), claim.measures)
        )
        for number, claim in enumerate(CLAIMS, start=1)
    ]


def text(judged: Sequence[Judged]) -> str:
    """The claims for a terminal: each on a line, its verdict on the next."""
    return "".join(
        f"{claim.number:2}. {claim.statement}\n    {claim.finding.symbol} {claim.verdict}. {claim.finding.figures}\n"
        for claim in judged
    )


def data(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    """The claims as plain data."""
    return [
        {"number": claim.number, "statement": claim.statement, "rule": claim.rule} | _finding(claim.finding)
        for claim in judged
    ]


def _finding(finding: Finding) -> dict[str, Any]:
    cases = [{"name": c.name, "verdict": word(c.ok), "words": c.words, "value": c.value} for c in finding.cases]
    return {"verdict": finding.verdict, "figures": finding.figures, "cases": cases}


def _right(datasets: Sequence[str], allowed: int = 0, placement: str = "paper") -> Rule:
    """A rule: at most so many wrong tracks on each dataset."""

    def rule(evidence: Evidence) -> Iterator[Case]:
        for dataset in datasets:
            wrong = evidence.mean("n_wrong", dataset, OURS, placement=placement)
            yield _case(_name(dataset), wrong, lambda v: v <= allowed, "wrong tracks: {:g}")

    return rule


def _umpm(evidence: Evidence) -> Iterator[Case]:
    yield from _right([take for take in UMPM if take != "p4_meet_12"])(evidence)
    yield from _right(["p4_meet_12"], allowed=1)(evidence)


def _below_rivals(evidence: Evidence) -> Iterator[Case]:
    for level in LEVELS:
        for pair in NOISY if level else PAIRS:
            for rival in ("ssc2d", "edsc"):
                mine, theirs = (evidence.mean("n_wrong", pair, name, level) for name in (OURS, rival))
                excess = None if mine is None or theirs is None else mine - theirs
                words = "" if excess is None else f"wrong tracks {mine:g} and {theirs:g}"
                name = f"{_name(pair)}, noise {level:g}, {LABELS[rival]}"
                yield _case(name, excess, lambda v: v <= 1e-9, words)


def _against(
    rival: str,
    datasets: Sequence[str],
    metric: str,
    holds: Callable[[float], bool],
    template: str,
    method: str = OURS,
    ratio: bool = True,
) -> Rule:
    """A rule on the ratio of a method's number to its rival's on each dataset, or on the difference."""

    def rule(evidence: Evidence) -> Iterator[Case]:
        for dataset in datasets:
            mine, other = (evidence.mean(metric, dataset, name) for name in (method, rival))
            value, words = None, ""
            if mine is not None and other is not None and (other or not ratio):
                value = mine / other if ratio else mine - other
                words = template.format(number(mine), number(other))
            yield _case(_name(dataset), value, holds, words)

    return rule


def _grows(evidence: Evidence) -> Iterator[Case]:
    for metric in ("e_3d", "e_ms"):
        for pair in NOISY:
            means = [evidence.mean(metric, pair, OURS, level) for level in LEVELS]
            known = [mean for mean in means if mean is not None]
            words = " ".join(number(mean) for mean in known)
            rank = None
            if len(known) == len(LEVELS):
                rank = float(spearmanr(LEVELS, known).statistic) if len(set(known)) > 1 else 0.0
            yield _case(
                f"{_name(pair)}, {metric}", rank, lambda v: v >= 0.8, f"{words} at {LEVELS}, rank correlation {{:.2f}}"
            )


EPSILON = 1e-3
"""A residual below this has converged whatever its largest value: a solve that starts near its end has no large one."""


def _converges(evidence: Evidence) -> Iterator[Case]:
    for pair in PAIRS:
        curves = next(iter(evidence.curves(pair, OURS)), {})
        names = [name for name in curves if name.startswith("residual_")]
        for name in names or ["residuals"]:
            y = curves[name][1] if name in curves else None
            left = None if y is None else float(y[-1] / max(np.max(y), EPSILON / 0.01))
            yield _case(f"{_name(pair)}, {name}", left, lambda v: v <= 0.01, "ends at {:.1e} of its largest, or of 0.1")
        y = curves["objective"][1] if "objective" in curves else None
        if y is not None:
            change = float(np.ptp(y[-max(2, len(y) // 10) :]) / abs(y[-1]))
            words = f"changes by {change:.1e} of itself over the last tenth"
            yield Case(f"{_name(pair)}, objective", change <= 1e-3, words)


def _case(name: str, value: float | None, holds: Callable[[float], bool], template: str) -> Case:
    """A case from a number; ``template`` is a format of the number."""
    if value is None:
        return Case(name, None, "not measured")
    return Case(name, holds(value), template.format(value), value)


def _name(dataset: str) -> str:
    return dataset.replace("_", " + ") if dataset not in UMPM else dataset


CLAIMS: tuple[Claim, ...] = (
    Claim(
        "table1",
        "Ours segments all eight pairs without error.",
        "no wrong track on each",
        _right(PAIRS),
        "wrong tracks",
    ),
    Claim(
        "table3",
        "Ours segments the UMPM takes without error, but for one track of p4_meet_12.",
        "no wrong track on each; at most one on p4_meet_12",
        _umpm,
        "wrong tracks",
    ),
    Claim(
        "noise",
        "Ours' segmentation error is never above SSC(2D)'s or EDSC's, on every pair and noise level.",
        "mean wrong tracks over the draws at most the rival's, at each pair and level",
        _below_rivals,
        "wrong tracks above the rival's",
    ),
    Claim(
        "table2",
        "Ours' 3D error is within a few per cent of BMM's.",
        "e_3d_dai at most 1.05 of BMM's on each pair",
        _against("bmm_ssc3d", PAIRS, "e_3d_dai", lambda v: v <= 1.05, "{} and {}, ratio {{:.3f}}"),
        "ratio",
    ),
    Claim(
        "noise",
        "Both errors grow with noise.",
        "rank correlation of level and mean error at least 0.8, for each pair and error",
        _grows,
        "rank correlation",
    ),
    Claim(
        "table1",
        "The primal residuals and the objective converge.",
        "each residual ends below 1 % of its largest, or below .001 of the scene's spread; the objective changes by at "
        "most 0.1 % over the last tenth",
        _converges,
        "last residual over largest, or over 0.1",
    ),
    Claim(
        "table4",
        "The neighbour term lowers the dense 3D error a little.",
        "e_3d with the term below that without, on each face",
        _against("ours_c", DENSE, "e_3d", lambda v: v < 1, "{} with, {} without", method="ours_cd"),
        "ratio",
    ),
    Claim(
        "table1",
        "Ours' affinity is more nearly block-diagonal than SSC's.",
        "share of the affinity between bodies below that of SSC(2D), on each pair",
        _against("ssc2d", PAIRS, "affinity_between", lambda v: v < 0, "share between bodies {}, SSC's {}", ratio=False),
        "share minus SSC's",
    ),
    Claim(
        "three_bodies",
        "Three bodies (stretch, dance, yoga) segment without error.",
        "no wrong track",
        _right(["stretch_dance_yoga"]),
        "wrong tracks",
    ),
    Claim(
        "intersecting",
        "It works when bodies intersect.",
        "no wrong track on each pair with both bodies in one place",
        _right(PAIRS, placement="intersecting"),
        "wrong tracks",
    ),
)
