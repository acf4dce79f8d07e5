"""The loop of an ADMM: when it stops, and how the penalty changes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from nrsfm.methods.numerics.admm import Admm
from nrsfm.methods.numerics.proximal import soft


def test_it_stops_when_every_residual_is_below_the_tolerance() -> None:
    reports: list[tuple[int, int, Mapping[str, float]]] = []
    admm = Admm(50, 0.1, progress=lambda *report: reports.append(report))
    for _ in admm:
        admm.report(one=1 / admm.iteration, other=0.5 / admm.iteration)
    assert (admm.iteration, admm.residual) == (11, 1 / 11) and admm.converged
    assert reports[0] == (1, 50, {"one": 1.0, "other": 0.5}) and len(reports) == 11


@pytest.mark.parametrize("residual", [1.0, float("nan")])
def test_it_stops_at_the_last_iteration(residual: float) -> None:
    admm = Admm(7, 0.1)
    for _ in admm:
        admm.report(gap=residual)
    assert admm.iteration == 7 and not admm.converged


def test_the_penalty_grows_to_its_cap() -> None:
    admm = Admm(4, 0.0, 1.0, growth=2.0, max_penalty=5.0)
    penalties = []
    for b in admm:
        penalties.append(b)
        admm.report(gap=1.0)
    assert penalties == [1.0, 2.0, 4.0, 5.0]


@pytest.mark.parametrize(("primal", "dual", "factor"), [(6.0, 1.0, 2.0), (1.0, 6.0, 0.5), (3.0, 1.0, 1.0)])
def test_the_penalty_is_balanced_every_tenth_iteration_of_the_first_half(
    primal: float, dual: float, factor: float
) -> None:
    admm = Admm(60, 0.0)
    factors = {}
    for _ in admm:
        factors[admm.iteration] = admm.balance(primal, dual)
    assert {n for n, f in factors.items() if f != 1} == ({10, 20} if factor != 1 else set())
    assert admm.penalty == factor**2


def test_it_solves_a_lasso(rng: np.random.Generator) -> None:
    """min 1/2 |A x - y|^2 + |x|_1: the gradient of the data term is a subgradient of the norm."""
    A, y = rng.standard_normal((30, 8)), rng.standard_normal(30)
    z, u = np.zeros(8), np.zeros(8)
    admm = Admm(5000, 1e-10)
    for b in admm:
        x = np.linalg.solve(A.T @ A + b * np.eye(8), A.T @ y + b * (z - u))
        before, z = z, soft(x + u, 1 / b)
        u += x - z
        u /= admm.balance(float(np.linalg.norm(x - z)), float(b * np.linalg.norm(z - before)))
    assert admm.converged
    gradient = A.T @ (y - A @ z)
    np.testing.assert_allclose(gradient[z != 0], np.sign(z[z != 0]), atol=1e-7)
    assert np.abs(gradient).max() <= 1 + 1e-7
