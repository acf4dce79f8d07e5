"""Wilcoxon's test against its definition, Holm's rule against its own, and the rows that take part."""

from __future__ import annotations

import itertools
import json
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from scipy.stats import rankdata

from nrsfm.reports.formats.records import json_text
from nrsfm.reports.tables.build import build
from nrsfm.reports.tables.model import Paired
from nrsfm.reports.tables.significance import EXACT, holm, signed_rank
from tests.reports.conftest import POINTS, make_answer


def by_counting(differences: np.ndarray) -> float:
    """The two-sided p-value from all 2^n assignments of signs to the ranks, zeros ranked and then dropped (Pratt)."""
    ranks = rankdata(np.abs(differences))[differences != 0]
    signs = np.sign(differences)[differences != 0]
    centre = ranks.sum() / 2
    seen = abs(ranks[signs > 0].sum() - centre)
    every = [abs(ranks @ np.array(s) - centre) for s in itertools.product((0, 1), repeat=len(ranks))]
    return float(np.mean(np.array(every) >= seen - 1e-9))


@pytest.mark.parametrize(
    "differences",
    [[-1, -2, -3, -4, -5, -6, -7, -8], [0, 0, -1, -1, 2, -3, 5, 5], [0.1, -0.1, 0.2, -0.2, 0.3], [0, 0, 0, 0, -1]],
)
def test_the_exact_p_value(differences: list[float]) -> None:
    assert signed_rank(np.array(differences, float)) == pytest.approx(by_counting(np.array(differences, float)))


def test_no_difference_is_no_evidence() -> None:
    assert signed_rank(np.zeros(8)) == 1.0
    assert signed_rank(-np.arange(1.0, 9)) == pytest.approx(2 / 2**8)


def test_the_normal_approximation_is_near_the_exact_value(rng: np.random.Generator) -> None:
    values = rng.standard_normal(EXACT + 1) + 0.3
    assert signed_rank(values) == pytest.approx(by_counting(values), abs=0.05)
    assert signed_rank(values) != by_counting(values)


def test_holm_by_hand() -> None:
    tests = [Paired("m", "M", "e", "", 8, 0, 0, 0.0, p) for p in (0.01, 0.04, 0.03, 0.005)]
    assert [test.corrected for test in holm(tests)] == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([]) == []


def table(ours: float, other: float, **more: Any) -> Any:
    rows = [
        make_answer(pair, method, 0, e_3d_dai=value + i / 1000, e_3d=0.1, **more)
        for i, pair in enumerate(POINTS)
        for method, value in (("ours", ours), ("bmm_ssc3d", other))
    ]
    return build("table2", rows)


def test_ours_against_each_baseline_over_the_rows() -> None:
    built = table(0.03, 0.04)
    error, wrong = built.tests
    assert (error.method, error.rows, error.better, error.worse) == ("bmm_ssc3d", 8, 8, 0)
    assert error.p == error.corrected == pytest.approx(2 / 2**8)
    assert error.median == pytest.approx(-0.01)
    assert (wrong.better, wrong.worse, wrong.p) == (0, 0, 1.0)
    assert json.loads(json_text(built))["tests"] == [asdict(error), asdict(wrong)]


def test_stand_ins_and_too_few_rows_take_no_part() -> None:
    assert table(0.03, 0.04, stand_in=True).tests == ()
    few = [make_answer(pair, m, 0, e_3d_dai=0.1) for pair in list(POINTS)[:4] for m in ("ours", "bmm_ssc3d")]
    assert build("table2", few).tests == ()
