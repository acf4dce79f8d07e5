"""The loop of an ADMM: one stopping rule, and a penalty that grows or is balanced.

Boyd, Parikh, Chu, Peleato, Eckstein, "Distributed optimization and statistical learning via the alternating direction
method of multipliers", 2011.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass, field

from nrsfm.methods.base import Progress


@dataclass
class Admm:
    """Iterations until every residual is below a tolerance, or the last iteration.

    Each iteration yields its penalty and ends with one call of :meth:`report` or :meth:`balance`::

        admm = Admm(max_iter, tol, penalty)
        for b in admm:
            ...
            multiplier /= admm.balance(primal, dual)
    """

    max_iter: int
    tol: float
    penalty: float = 1.0  # that of the first iteration
    _: KW_ONLY
    growth: float = 1.0  # factor of the penalty after each iteration
    max_penalty: float = float("inf")
    progress: Progress | None = None  # called with the residuals of every iteration
    iteration: int = field(default=0, init=False)
    residual: float = field(default=float("inf"), init=False)

    def __iter__(self) -> Iterator[float]:
        while self.iteration < self.max_iter and not self.converged:
            self.iteration += 1
            yield self.penalty
            self.penalty = min(self.max_penalty, self.growth * self.penalty)

    @property
    def converged(self) -> bool:
        return self.residual < self.tol

    def report(self, **residuals: float) -> None:
        """Record the residuals of the iteration."""
        self.residual = max(residuals.values())
        if self.progress is not None:
            self.progress(self.iteration, self.max_iter, residuals)

    def balance(self, primal: float, dual: float) -> float:
        """Record the residuals; returns the factor of the penalty, by which scaled multipliers are to be divided.

        It can differ from 1 in every tenth iteration of the first half. The second half keeps the penalty, so that the
        iteration converges.
        """
        self.report(primal=primal, dual=dual)
        if self.converged or self.iteration % 10 or self.iteration >= self.max_iter // 2:
            return 1.0
        factor = balancing_factor(primal, dual)
        self.penalty *= factor
        return factor


def balancing_factor(primal: float, dual: float) -> float:
    """Factor of the penalty that brings residuals to one size: 2, 1/2, or 1 where they are within 5 of each other.

    Boyd et al., section 3.4.1.
    """
    return 2.0 if primal > 5 * dual else 0.5 if dual > 5 * primal else 1.0
