"""Claims: held where every case holds, refuted by one counterexample, and not tested where a case is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from nrsfm.harness.record.tracked import Tracked
from nrsfm.reports.claims import claims
from nrsfm.reports.claims.claims import LEVELS, NOISY, PAIRS, judge
from nrsfm.reports.claims.findings import HELD, NOT_HELD, NOT_TESTED, UMPM, Evidence
from tests.reports.conftest import make_answer

CURVES = {"history_objective": np.ones(100), "history_shape": np.geomspace(1, 1e-6, 100)}


def run(dataset: str, method: str, wrong: int = 0, placement: str = "paper", **more: Any) -> Tracked:
    tracked = make_answer(dataset, method, wrong, **more)[1]
    metrics = tracked.outcome.metrics | {"affinity_between": more.get("between", 0.1)}
    return replace(tracked, outcome=replace(tracked.outcome, placement=placement, metrics=metrics))


def verdict(number: int, runs: Sequence[Tracked], curves: Any = None) -> str:
    found = judge(Evidence(runs, lambda _: curves or {}))
    assert [claim.number for claim in found] == list(range(1, 11))
    return found[number - 1].verdict


@pytest.mark.parametrize(("number", "placement"), [(1, "paper"), (10, "intersecting")])
def test_all_pairs(number: int, placement: str) -> None:
    runs = [run(pair, "ours", placement=placement) for pair in PAIRS]
    assert verdict(number, runs) == HELD
    assert verdict(number, runs[:-1]) == NOT_TESTED
    assert verdict(number, [*runs[1:], run(PAIRS[0], "ours", 1, placement)]) == NOT_HELD
    assert verdict(number, [run(PAIRS[0], "ours", 1, placement)]) == NOT_HELD  # one counterexample is enough
    assert verdict(11 - number, runs) == NOT_TESTED  # the other placement says nothing


@pytest.mark.parametrize("change", ["gaps", "counted", "native"])
def test_runs_under_another_setting_say_nothing_of_a_claim(change: str) -> None:
    """They bear the dataset and the method of the paper's runs and must not stand in their place."""
    other = run(PAIRS[0], "ours", 9)
    outcome = other.outcome
    changed: dict[str, dict[str, Any]] = {
        "gaps": {"parameters": outcome.parameters | {"gaps": {"kind": "random", "share": 0.2}}},
        "counted": {"metrics": outcome.metrics | {"n_bodies_found": 1.0}},
        "native": {"motion": "native"},
    }
    other = replace(other, outcome=replace(outcome, **changed[change]))
    assert verdict(1, [*(run(pair, "ours") for pair in PAIRS), other]) == HELD


def test_three_bodies() -> None:
    assert verdict(9, [run("stretch_dance_yoga", "ours")]) == HELD
    assert verdict(9, [run("stretch_dance_yoga", "ours", 1)]) == NOT_HELD
    assert verdict(9, []) == NOT_TESTED


def test_umpm_allows_one_track_on_one_take() -> None:
    takes = [run(take, "ours", int(take == "p4_meet_12")) for take in UMPM]
    assert verdict(2, takes) == HELD
    assert verdict(2, [*takes[1:], run(UMPM[0], "ours", 1)]) == NOT_HELD


def grid(ours: Any, rival: Any) -> list[Tracked]:
    """Runs over pairs, levels and two draws, wrong tracks by level and draw."""
    return [
        run(pair, method, wrong(level, repeat), level=level, repeat=repeat, e_3d=0.1 + level)
        for pair in PAIRS
        for level in LEVELS
        if not level or pair in NOISY
        for repeat in ((0, 1) if level else (0,))
        for method, wrong in (("ours", ours), ("ssc2d", rival), ("edsc", rival))
    ]


def test_never_above_its_rivals_in_the_mean_over_draws() -> None:
    assert verdict(3, grid(lambda level, _: 1, lambda level, _: 1)) == HELD
    mixed = grid(lambda level, repeat: 2 * repeat if level else 1, lambda level, _: 1)
    assert verdict(3, mixed) == HELD
    assert verdict(3, grid(lambda level, _: 1 + (level == 0.05), lambda level, _: 1)) == NOT_HELD
    assert verdict(3, [r for r in mixed if r.outcome.level < 0.05]) == NOT_TESTED


def test_both_errors_grow() -> None:
    assert verdict(5, grid(lambda level, _: round(100 * level), lambda level, _: 0)) == HELD
    assert verdict(5, grid(lambda level, _: 3, lambda level, _: 0)) == NOT_HELD


@pytest.mark.parametrize(("ratio", "expected"), [(1.04, HELD), (1.06, NOT_HELD)])
def test_near_bmm(ratio: float, expected: str) -> None:
    runs = [run(pair, m, e_3d_dai=0.1 * f) for pair in PAIRS for m, f in (("ours", ratio), ("bmm_ssc3d", 1))]
    assert verdict(4, runs) == expected
    assert verdict(4, [r for r in runs if r.outcome.method == "ours"]) == NOT_TESTED


def test_convergence_reads_the_curves() -> None:
    runs = [run(pair, "ours") for pair in PAIRS]
    assert verdict(6, runs, CURVES) == HELD
    assert verdict(6, runs, CURVES | {"history_code": np.full(100, 0.5)}) == NOT_HELD
    assert verdict(6, runs, CURVES | {"history_code": np.full(100, 0.0005)}) == HELD
    assert verdict(6, runs, CURVES | {"history_seconds": np.full(100, 0.5)}) == HELD
    assert verdict(6, runs, CURVES | {"history_objective": np.arange(1.0, 101)}) == NOT_HELD
    assert verdict(6, runs) == NOT_TESTED


def test_block_diagonal() -> None:
    runs = [run(p, m, between=b) for p in PAIRS for m, b in (("ours", 0.01), ("ssc2d", 0.1))]
    assert verdict(8, runs) == HELD
    assert verdict(8, [*runs[1:], run(PAIRS[0], "ours", between=0.2)]) == NOT_HELD


def test_the_neighbour_term_helps_on_each_face() -> None:
    runs = [run(f, m, e_3d=e) for f in claims.DENSE for m, e in (("ours_c", 0.05), ("ours_cd", 0.049))]
    assert verdict(7, runs) == HELD
    assert verdict(7, [*runs[:-1], run(claims.DENSE[-1], "ours_cd", e_3d=0.051)]) == NOT_HELD
    assert verdict(7, runs[:-1]) == NOT_TESTED


def test_text_and_data_say_the_same() -> None:
    judged = judge(Evidence([run(pair, "ours", int(pair == PAIRS[2])) for pair in PAIRS], lambda _: {}))
    text, data = claims.text(judged), claims.data(judged)
    assert "1. Ours segments all eight pairs without error." in text
    assert "✗ not held. 7 of 8 hold, 1 not; wrong tracks 0 to 1" in text
    assert data[0]["verdict"] == NOT_HELD
    worst = judged[0].finding.evidence[0]
    assert worst == "✗ shark + stretch: wrong tracks: 1"


def test_the_adaptive_method_is_no_evidence() -> None:
    assert verdict(1, [run(pair, "adaptive") for pair in PAIRS]) == NOT_TESTED


def test_newest_run_of_a_trial_stands() -> None:
    runs = [run(pair, "ours") for pair in PAIRS]
    assert verdict(1, [run(PAIRS[0], "ours", 5), *runs]) == HELD
