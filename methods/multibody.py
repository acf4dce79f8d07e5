"""Ours: multi-body non-rigid structure from motion, reconstruction and segmentation in one ADMM.

Kumar, Dai, Li, "Multi-body non-rigid structure-from-motion", 3DV 2016. Equation numbers below are of arXiv 1607.04515.

    min  1/2 |W - R S|^2 + l1 |E|_1 + l2 |S#|_*
    s.t. S# = g(S),  S = S C,  C D = E,  1'C = 1',  diag(C) = 0

D = I for sparse tracks; :mod:`methods.spatial` has the D of dense ones. :mod:`methods.implicit` is the same iteration
without a P x P array. :mod:`methods.rough` has the variant that runs by default: the code of rough motion, with slack.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from methods.backend import largest, on_device, to_numpy
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
    no_edges,
    standardise,
)
from methods.bmm import fit_shape
from methods.gaps import fill
from methods.implicit import ImplicitProblem, implicit_bytes
from methods.lagrangian import Problem, dense_bytes
from methods.rough import RoughProblem
from methods.spatial import Neighbours, SpatialProblem
from methods.spectral import spectral_clustering

DIAGONALS = ("threshold", "exact", "paper")
FORMS = ("auto", "dense", "implicit")
PRECISIONS: Mapping[str, tuple[Any, float]] = {"double": (np.float64, 1e-13), "single": (np.float32, 1e-5)}


class MultiBody(Method):
    """The paper's method, by default on rough motion.

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
    spatial : float
        Weight of the spatial term over l1, for dense tracks with neighbours; 0 leaves it out. With ``period`` None.
    form : {"auto", "dense", "implicit"}
        ``implicit`` keeps the code as a sparse and a low-rank matrix, with the same iterates to rounding; ``auto``
        takes it where ``period`` is None and the dense form would need more than ``dense_gb``.
    dense_gb : float
        In GB (2^30 bytes).
    precision : {"double", "single"}
        Of the implicit form. Single solves the S-step to 1e-5 and keeps no direction of S that is fainter.
    device : str or None
        Where the dense form computes, without the spatial term: None is numpy, ``cpu`` and ``cuda`` are PyTorch's.
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
        spatial: float = 0.0,
        form: str = "auto",
        dense_gb: float = 0.25,
        precision: str = "double",
        device: str | None = None,
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
        self.spatial = spatial
        self.form = form
        self.dense_gb = dense_gb
        self.precision = precision
        self.device = device

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
        check_bodies(n_bodies, tracks.shape[2], least=1)
        self._check_settings()
        if visible is not None and self.device is not None:
            raise MethodError("method.device does not go with gaps in the tracks; leave it out")
        problem = self._problem(data.W, cameras, no_edges() if edges is None else edges)
        state = problem.start(self.penalty)
        history: dict[str, list[float]] = defaultdict(list)
        for iteration in range(1, self.max_iter + 1):
            start = time.process_time()
            state, gaps = problem.iterate(state)
            if visible is not None:
                problem = problem.at(fill(problem.W, cameras @ state.S, visible))
            history["seconds"].append(time.process_time() - start)
            history["operations"].append(problem.operations(state))
            residuals = {name: largest(gap) for name, gap in gaps.items()}
            history["objective"].append(problem.objective(state))
            for name, value in residuals.items():
                history[name].append(value)
            if progress is not None:
                progress(iteration, self.max_iter, residuals)
            if max(residuals.values()) < self.tol:
                break
            state = replace(state, b=min(self.max_penalty, self.growth * state.b))
        code = abs(to_numpy(state.E)[:, : tracks.shape[2]])
        affinity = code + code.T
        alone = np.zeros(tracks.shape[2], dtype=np.int64)
        several = n_bodies is None or n_bodies > 1
        return Reconstruction(
            labels=spectral_clustering(affinity, n_bodies, seed=self.seed) if several else alone,
            structure=to_numpy(state.S) * data.scale,
            cameras=cameras,
            affinity=affinity,
            history={name: np.array(values) for name, values in history.items()},
        )

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """See :meth:`methods.base.Method.memory`."""
        n_edges = n_edges if self.spatial else 0
        if self._implicit(n_frames, n_points, n_edges):
            return implicit_bytes(n_frames, n_points, n_edges, 4 if self.precision == "single" else 8)
        return dense_bytes(n_frames, n_points, n_edges)

    def _implicit(self, n_frames: int, n_points: int, n_edges: int) -> bool:
        fits = self.period is None and self.diagonal == "threshold"
        large = dense_bytes(n_frames, n_points, n_edges) > self.dense_gb * 2**30
        return self.form == "implicit" or (self.form == "auto" and fits and large)

    def _problem(self, W: Array, cameras: Array, edges: NDArray[np.int64]) -> Problem:
        printed = (W, cameras, self.l1, self.l2, self.diagonal)
        F, _, P = W.shape
        if self.period is not None:
            return RoughProblem(*printed, self.expression, self.period)
        implicit = self._implicit(F, P, len(edges) if self.spatial else 0)
        dtype, tol = PRECISIONS[self.precision] if implicit else PRECISIONS["double"]
        neighbours = Neighbours(edges, P, self.spatial, dtype) if self.spatial else None
        if implicit:
            return ImplicitProblem(*printed, neighbours=neighbours, dtype=dtype, cg_tol=tol)
        if neighbours:
            return SpatialProblem(*printed, neighbours=neighbours)
        W, cameras = on_device(W, self.device), on_device(cameras, self.device)
        return Problem(W, cameras, self.l1, self.l2, self.diagonal)

    def _check_settings(self) -> None:
        if self.diagonal not in DIAGONALS:
            raise MethodError(f"method.diagonal is {self.diagonal!r}, wanted one of {', '.join(DIAGONALS)}")
        for name in ("l1", "l2", "expression", "penalty", "max_penalty", "tol"):
            check_setting(self, name, 0)
        if self.period is not None:
            check_setting(self, "period", 0)
            if self.spatial or self.form == "implicit":
                raise MethodError(
                    "method.spatial and method.form=implicit go with the printed code: set method.period=null"
                )
        for name, words in (("form", FORMS), ("precision", tuple(PRECISIONS))):
            if getattr(self, name) not in words:
                raise MethodError(f"method.{name} is {getattr(self, name)!r}, wanted one of {', '.join(words)}")
        if self.device is not None and (self.period is not None or self.spatial or self.form != "dense"):
            raise MethodError("method.device goes with method.period=null, method.form=dense and method.spatial=0")
        if self.form == "implicit" and self.diagonal != "threshold":
            raise MethodError("method.form=implicit keeps the diagonal by method.diagonal=threshold alone")
        for name in ("spatial", "dense_gb"):
            check_setting(self, name, 0, strict=False)
        check_setting(self, "growth", 1, strict=False)
        check_setting(self, "max_iter", 1, strict=False, whole=True)


def _completed(tracks: Array, cameras: Array, visible: Mask) -> Array:
    """Tracks whose gaps hold what the structure of least nuclear norm shows there, centred."""
    data = standardise(tracks, visible)
    return data.scale * fill(data.W, cameras @ fit_shape(data.W, cameras, 0.0, visible).structure, visible)
