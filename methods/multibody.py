"""Ours: multi-body non-rigid structure from motion, reconstruction and segmentation in one ADMM.

Kumar, Dai, Li, "Multi-body non-rigid structure-from-motion", 3DV 2016. Equation numbers below are of arXiv 1607.04515.

    min  1/2 |W - R S|^2 + l1 |E|_1 + l2 |S#|_*
    s.t. S# = g(S),  S = S C,  C = E,  1'C = 1',  diag(C) = 0

:mod:`methods.rough` has the variant that runs by default: the code of rough motion, with slack.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from methods.base import (
    Array,
    Mask,
    Method,
    MethodError,
    Progress,
    Reconstruction,
    check_bodies,
    check_cameras,
    check_setting,
    standardise,
)
from methods.bmm import fit_shape
from methods.gaps import fill
from methods.lagrangian import Problem
from methods.rough import RoughProblem
from methods.spectral import spectral_clustering

DIAGONALS = ("threshold", "exact", "paper")


class MultiBody(Method):
    """The paper's method for sparse tracks (D = I), by default on rough motion.

    Parameters
    ----------
    l1, l2 : float
        Weights of |E|_1 and of |S#|_*: l2 in standardised units; l1 too in the printed formulation, and in parts of the
        weight at which the code vanishes otherwise.
    expression : float
        Weight of the self-expression against the image residual (:class:`methods.rough.RoughProblem`).
    period : float or None
        Motion slower than this many frames plays no part in the code. None is the printed formulation: S = S C for
        whole trajectories, without slack; l2 = 0.1, penalty = 1e-3 and growth = 1.1 go with it.
    penalty, growth, max_penalty : float
        The penalty b of the augmented Lagrangian: its start (a hundredth of l2 works), its factor per iteration and
        its cap.
    max_iter : int
    tol : float
        Stop when the infinity norms of all gaps between split variables are below it (the paper's epsilon).
    diagonal : {"threshold", "exact", "paper"}
        How diag(C) = 0 is kept. ``threshold``: by the E-step, an exact proximal step. ``exact``: by the C-step,
        solved under the constraint. ``paper``: C - diag(C) after the C-step, as printed, which breaks the
        minimisation.
    seed : int
        Of k-means.
    """

    provides = frozenset({"labels", "structure"})
    version = "2"

    def __init__(
        self,
        *,
        l1: float = 3e-3,
        l2: float = 1e-4,
        expression: float = 0.01,
        period: float | None = 16.0,
        penalty: float = 1e-6,
        growth: float = 1.03,
        max_penalty: float = 1e3,
        max_iter: int = 250,
        tol: float = 1e-8,
        diagonal: str = "threshold",
        seed: int = 0,
    ) -> None:
        self.l1 = l1
        self.l2 = l2
        self.expression = expression
        self.period = period
        self.penalty = penalty
        self.growth = growth
        self.max_penalty = max_penalty
        self.max_iter = max_iter
        self.tol = tol
        self.diagonal = diagonal
        self.seed = seed

    def reconstruct(
        self,
        tracks: Array,
        cameras: Array,
        n_bodies: int | None,
        *,
        visible: Mask | None = None,
        edges: NDArray[np.int64] | None = None,
        progress: Progress | None = None,
    ) -> Reconstruction:
        """See :meth:`methods.base.Method.reconstruct`.

        Hidden entries of W are one more block of variables: they start from the completion of the block matrix method
        and take, in every iteration, the values R S + t 1' that minimise the objective. At the end of it all their
        residual is zero, so that the data term is that of the visible tracks.
        """
        check_cameras(cameras, len(tracks))
        data = standardise(tracks if visible is None else _completed(tracks, cameras, visible))
        check_bodies(n_bodies, tracks.shape[2])
        self._check_settings()
        problem = self._problem(data.W, cameras)
        state = problem.start(self.penalty)
        history: dict[str, list[float]] = defaultdict(list)
        for iteration in range(1, self.max_iter + 1):
            state, gaps = problem.iterate(state)
            if visible is not None:
                problem = problem.at(fill(problem.W, cameras @ state.S, visible))
            residuals = {name: float(np.abs(gap).max()) for name, gap in gaps.items()}
            history["objective"].append(problem.objective(state))
            for name, value in residuals.items():
                history[name].append(value)
            if progress is not None:
                progress(iteration, self.max_iter, residuals)
            if max(residuals.values()) < self.tol:
                break
            state = replace(state, b=min(self.max_penalty, self.growth * state.b))
        affinity = np.abs(state.E) + np.abs(state.E.T)
        return Reconstruction(
            labels=spectral_clustering(affinity, n_bodies, seed=self.seed),
            structure=state.S * data.scale,
            cameras=cameras,
            affinity=affinity,
            history={name: np.array(values) for name, values in history.items()},
        )

    def _problem(self, W: Array, cameras: Array) -> Problem:
        if self.period is None:
            return Problem(W, cameras, self.l1, self.l2, self.diagonal)
        return RoughProblem(W, cameras, self.l1, self.l2, self.diagonal, self.expression, self.period)

    def _check_settings(self) -> None:
        if self.diagonal not in DIAGONALS:
            raise MethodError(f"method.diagonal is {self.diagonal!r}, wanted one of {', '.join(DIAGONALS)}")
        for name in ("l1", "l2", "expression", "penalty", "max_penalty", "tol"):
            check_setting(self, name, 0)
        if self.period is not None:
            check_setting(self, "period", 0)
        check_setting(self, "growth", 1, strict=False)
        check_setting(self, "max_iter", 1, strict=False, whole=True)


def _completed(tracks: Array, cameras: Array, visible: Mask) -> Array:
    """Tracks whose gaps hold what the structure of least nuclear norm shows there, centred."""
    data = standardise(tracks, visible)
    return data.scale * fill(data.W, cameras @ fit_shape(data.W, cameras, 0.0, visible).structure, visible)
