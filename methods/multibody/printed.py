"""Ours as printed: multi-body non-rigid structure from motion, reconstruction and segmentation in one ADMM.

Kumar, Dai, Li, "Multi-body non-rigid structure-from-motion", 3DV 2016. Equation numbers below are of arXiv 1607.04515.

    min  1/2 |W - R S|^2 + l1 |E|_1 + l2 |S#|_*
    s.t. S# = g(S),  S = S C,  C D = E,  1'C = 1',  diag(C) = 0

D = I for sparse tracks; :mod:`nrsfm.methods.multibody.spatial` has the D of dense ones. :mod:`nrsfm.methods.multibody.implicit` is the same iteration
without a P x P array. :mod:`nrsfm.methods.multibody.adaptive` has the variant with slack and weights from the data.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.methods.base import (
    DIAGONALS,
    Array,
    Mask,
    Method,
    MethodError,
    Progress,
    Reconstruction,
    check_bodies,
    check_cameras,
    check_setting,
    check_word,
    no_edges,
    stage,
    standardise,
)
from nrsfm.methods.clustering.spectral import spectral_clustering
from nrsfm.methods.multibody.implicit import ImplicitProblem, implicit_bytes
from nrsfm.methods.multibody.lagrangian import Problem, dense_bytes, minimise
from nrsfm.methods.multibody.spatial import Neighbours, SpatialProblem
from nrsfm.methods.numerics.backend import on_device, to_numpy
from nrsfm.methods.structure.bmm import complete_by_shape

FORMS = ("auto", "dense", "implicit")


CUTS = ("means", "cheapest")


PRECISIONS: Mapping[str, tuple[Any, float]] = {"double": (np.float64, 1e-13), "single": (np.float32, 1e-5)}


class MultiBody(Method):
    """The paper's method.

    Parameters
    ----------
    l1, l2 : float
        Weights of |E|_1 and of |S#|_*, in standardised units.
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
    cut : {"means", "cheapest"}
        ``means``: the labels are those of k-means on the eigenvectors. ``cheapest``: of these and of splits along one
        eigenvector at a time, those of the smaller normalised cut, which tens of thousands of tracks need.
    spatial : float
        Weight of the spatial term over l1, for dense tracks with neighbours; 0 leaves it out.
    form : {"auto", "dense", "implicit"}
        ``implicit`` keeps the code as a sparse and a low-rank matrix, with the same iterates to rounding; ``auto``
        takes it where the dense form would need more than ``dense_gb``.
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
        l2: float = 0.1,
        penalty: float = 1e-3,
        growth: float = 1.1,
        max_penalty: float = 1e3,
        max_iter: int = 250,
        tol: float = 1e-8,
        diagonal: str = "threshold",
        seed: int = 0,
        cut: str = "means",
        spatial: float = 0.0,
        form: str = "auto",
        dense_gb: float = 0.25,
        precision: str = "double",
        device: str | None = None,
    ) -> None:
        self.l1 = l1
        self.l2 = l2
        self.penalty = penalty
        self.growth = growth
        self.max_penalty = max_penalty
        self.max_iter = max_iter
        self.tol = tol
        self.diagonal = diagonal
        self.seed = seed
        self.cut = cut
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
        """See :meth:`nrsfm.methods.base.Method.reconstruct`."""
        check_cameras(cameras, len(tracks))
        data = standardise(complete_by_shape(tracks, cameras, visible, progress))
        check_bodies(n_bodies, tracks.shape[2], least=1)
        self._check_settings()
        if visible is not None and self.device is not None:
            raise MethodError("method.device does not go with gaps in the tracks; leave it out")
        problem = self._problem(data.W, cameras, no_edges() if edges is None else edges)
        state = problem.start(self.penalty)
        stage(progress, "structure and code")
        state, history = minimise(
            problem,
            state,
            self.max_iter,
            self.tol,
            growth=self.growth,
            max_penalty=self.max_penalty,
            visible=visible,
            progress=progress,
        )
        code = abs(to_numpy(state.E)[:, : tracks.shape[2]])
        affinity = code + code.T
        stage(progress, "clustering")
        return Reconstruction(
            labels=spectral_clustering(affinity, n_bodies, seed=self.seed, cheapest=self.cut == "cheapest"),
            structure=to_numpy(state.S) * data.scale,
            cameras=cameras,
            affinity=affinity,
            history=history,
        )

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """See :meth:`nrsfm.methods.base.Method.memory`."""
        n_edges = n_edges if self.spatial else 0
        if self._implicit(n_frames, n_points, n_edges):
            return implicit_bytes(n_frames, n_points, n_edges, 4 if self.precision == "single" else 8)
        return dense_bytes(n_frames, n_points, n_edges)

    def _implicit(self, n_frames: int, n_points: int, n_edges: int) -> bool:
        large = dense_bytes(n_frames, n_points, n_edges) > self.dense_gb * 2**30
        return self.form == "implicit" or (self.form == "auto" and self.diagonal == "threshold" and large)

    def _problem(self, W: Array, cameras: Array, edges: NDArray[np.int64]) -> Problem:
        printed = (W, cameras, self.l1, self.l2, self.diagonal)
        F, _, P = W.shape
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
        for name, words in (("diagonal", DIAGONALS), ("cut", CUTS), ("form", FORMS), ("precision", tuple(PRECISIONS))):
            check_word(self, name, words)
        for name in ("l1", "l2", "penalty", "max_penalty", "tol"):
            check_setting(self, name, 0)
        if self.device is not None and (self.spatial or self.form != "dense"):
            raise MethodError("method.device goes with method.form=dense and method.spatial=0")
        if self.form == "implicit" and self.diagonal != "threshold":
            raise MethodError("method.form=implicit keeps the diagonal by method.diagonal=threshold alone")
        for name in ("spatial", "dense_gb"):
            check_setting(self, name, 0, strict=False)
        check_setting(self, "growth", 1, strict=False)
        check_setting(self, "max_iter", 1, strict=False, whole=True)
