"""The loop of an ADMM: one stopping rule, and a penalty that grows or is balanced.

Boyd, Parikh, Chu, Peleato, Eckstein, "Distributed optimization and statistical learning via the alternating direction
method of multipliers", 2011.
"""

from __future__ import annotations

from collections.abc import Iterator

from nrsfm.methods.base import Progress


class Admm:
    """Iterations until every residual is below a tolerance, or the last iteration.

    Each iteration yields its penalty and ends with one call of :meth:`report` or :meth:`balance`::

        admm = Admm(max_iter, tol, penalty)
        for b in admm:
            ...
            multiplier /= admm.balance(primal, dual)

    Parameters
    ----------
    max_iter : int
    tol : float
    penalty : float
        That of the first iteration.
    growth, max_penalty : float
        Factor of the penalty after each iteration, and its cap.
    progress : callable, optional
        Called with the residuals of every iteration.
    """

    def __init__(
        self,
        max_iter: int,
        tol: float,
        penalty: float = 1.0,
        *,
        growth: float = 1.0,
        max_penalty: float = float("inf"),
        progress: Progress | None = None,
    ) -> None:
        self.max_iter = max_iter
        self.tol = tol
        self.penalty = penalty
        self.growth = growth
        self.max_penalty = max_penalty
        self.progress = progress
        self.iteration = 0
        self.residual = float("inf")

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
