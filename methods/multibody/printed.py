"""Ours as printed: multi-body non-rigid structure from motion, reconstruction and segmentation in one ADMM.

Kumar, Dai, Li, "Multi-body non-rigid structure-from-motion", 3DV 2016. Equation numbers below are of arXiv 1607.04515.

    min  1/2 |W - R S|^2 + l1 |E|_1 + l2 |S#|_*
    s.t. S# = g(S),  S = S C,  C D = E,  1'C = 1',  diag(C) = 0

D = I for sparse tracks; :mod:`nrsfm.methods.multibody.spatial` has the D of dense ones.
:mod:`nrsfm.methods.multibody.implicit` is the same iteration without a P x P array.
:mod:`nrsfm.methods.multibody.adaptive` has the variant with slack and weights from the data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.methods import base
from nrsfm.methods.base import Array, Mask, Method, MethodError, Observations, Reconstruction
from nrsfm.methods.clustering.spectral import CUTS, spectral_clustering
from nrsfm.methods.gaps import complete_by
from nrsfm.methods.multibody.implicit import ImplicitProblem, implicit_bytes
from nrsfm.methods.multibody.lagrangian import PrintedProblem, dense_bytes
from nrsfm.methods.multibody.problem import DIAGONALS, minimise
from nrsfm.methods.multibody.spatial import Neighbours, SpatialProblem
from nrsfm.methods.numerics.admm import Admm
from nrsfm.methods.structure.bmm import fit_shape

STARTS = ("bmm", "pseudoinverse")
FORMS = ("auto", "dense", "implicit")
PRECISIONS: Mapping[str, tuple[Any, float]] = {"double": (np.float64, 1e-13), "single": (np.float32, 1e-5)}


@dataclass(kw_only=True, eq=False, repr=False)
class MultiBody(Method):
    """The paper's method.

    Parameters
    ----------
    l1, l2 : float
        Weights of |E|_1 and of |S#|_*, in standardised units.
    penalty, growth, max_penalty : float
        The penalty b of the augmented Lagrangian: its start (a hundredth of l2 works), its factor per iteration and
        its cap.
    tol : float
        Stop when the infinity norms of all gaps between split variables are below it (the paper's epsilon).
    start : {"bmm", "pseudoinverse"}
        The first S: the structure of least nuclear norm with R S = W (:func:`nrsfm.methods.structure.bmm.fit_shape`),
        or pinv(R) W, whose points have no depth.
    diagonal : {"threshold", "exact", "paper"}
        How diag(C) = 0 is kept. ``threshold``: by the E-step, an exact proximal step. ``exact``: by the C-step,
        solved under the constraint. ``paper``: C - diag(C) after the C-step, as printed, which breaks the
        minimisation.
    seed : int
        Of k-means.
    cut : {"means", "cheapest", "rotation"}
        See :func:`nrsfm.methods.clustering.spectral.spectral_clustering`. Tens of thousands of tracks need
        ``cheapest``.
    spatial : float
        Weight of the spatial term over l1, for dense tracks with neighbours; 0 leaves the term out.
    form : {"auto", "dense", "implicit"}
        ``implicit`` keeps the code as a sparse plus a low-rank matrix, with the same iterates to rounding; ``auto``
        takes it where the dense form would need more than ``dense_gb``.
    dense_gb : float
        In GB (2^30 bytes).
    precision : {"double", "single"}
        Of the implicit form. Single solves the S-step to 1e-5 and drops fainter directions of S.
    """

    provides = frozenset({"labels", "structure"})
    handles_gaps = True
    version = "2"

    l1: float = 3e-3
    l2: float = 0.15
    penalty: float = 1e-3
    growth: float = 1.1
    max_penalty: float = 1.0
    max_iter: int = 400
    tol: float = 1e-8
    start: str = "pseudoinverse"
    diagonal: str = "threshold"
    seed: int = 0
    cut: str = "means"
    spatial: float = 0.0
    form: str = "auto"
    dense_gb: float = 0.25
    precision: str = "double"

    def reconstruct(self, observations: Observations, n_bodies: int | None) -> Reconstruction:
        """See :meth:`nrsfm.methods.base.Method.reconstruct`."""
        cameras, progress = observations.required_cameras(), observations.progress
        n_points = observations.tracks.shape[2]
        base.check_bodies(n_bodies, n_points, least=1)
        self._check_settings()

        def shape(W: Array, cameras: Array, visible: Mask) -> Array:
            return fit_shape(W, cameras, visible=visible, progress=progress).structure

        data = base.standardise(complete_by(observations, shape))
        problem = self._problem(data.W, cameras, observations.edges)
        observations.stage("structure and code")
        admm = Admm(
            self.max_iter, self.tol, self.penalty, growth=self.growth, max_penalty=self.max_penalty, progress=progress
        )
        first = fit_shape(data.W, cameras).structure if self.start == "bmm" else None
        state, history = minimise(problem, problem.start(self.penalty, first), admm, observations.visible)
        code = abs(state.E[:, :n_points])
        affinity = code + code.T
        observations.stage("clustering")
        return Reconstruction(
            labels=spectral_clustering(affinity, n_bodies, seed=self.seed, cut=self.cut),
            structure=state.S * data.scale,
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

    def _problem(self, W: Array, cameras: Array, edges: NDArray[np.int64] | None) -> PrintedProblem:
        pairs = np.zeros((0, 2), dtype=np.int64) if edges is None else edges
        F, _, P = W.shape
        implicit = self._implicit(F, P, len(pairs) if self.spatial else 0)
        dtype, tol = PRECISIONS[self.precision if implicit else "double"]
        neighbours = Neighbours(pairs, P, self.spatial, dtype) if self.spatial else None
        if implicit:
            return ImplicitProblem(W, cameras, self.l1, self.l2, neighbours=neighbours, dtype=dtype, cg_tol=tol)
        if neighbours:
            return SpatialProblem(W, cameras, self.l1, self.l2, neighbours=neighbours)
        return PrintedProblem(W, cameras, self.l1, self.l2, diagonal=self.diagonal)

    def _check_settings(self) -> None:
        words = {"start": STARTS, "diagonal": DIAGONALS, "cut": CUTS, "form": FORMS, "precision": tuple(PRECISIONS)}
        for name, choices in words.items():
            base.check_word(self, name, choices)
        base.check_positive(self, "l1", "l2", "penalty", "max_penalty", "tol")
        base.check_at_least(self, 0, "spatial", "dense_gb")
        base.check_at_least(self, 1, "growth")
        base.check_count(self, "max_iter")
        if self.diagonal != "threshold" and (self.spatial or self.form == "implicit"):
            raise MethodError(
                f"MultiBody: diagonal is {self.diagonal!r}; the spatial term and the implicit form need 'threshold'"
            )
