"""Single-body non-rigid structure from motion by nuclear-norm minimisation: the block matrix method.

Dai, Li, He, "A simple prior-free method for non-rigid structure-from-motion factorization", CVPR 2012; IJCV 2014.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from nrsfm.methods import base
from nrsfm.methods.base import Array, Mask, Method, MethodError, Observations, Progress, Reconstruction
from nrsfm.methods.gaps import misfit
from nrsfm.methods.numerics.admm import Admm
from nrsfm.methods.numerics.linear import TINY
from nrsfm.methods.numerics.proximal import singular_value_threshold


@dataclass(frozen=True)
class ShapeFit:
    """Solution of the shape step, with the multiplier and penalty that its ADMM ended with.

    The multiplier belongs to g(S) = S#; it and the penalty b are at weight 1 of the nuclear norm.
    """

    structure: Array  # S, (F, 3, P)
    shape: Array  # its copy S# of lower rank, (F, 3, P)
    multiplier: Array  # (F, 3, P)
    penalty: float
    nuclear_norm: float
    residual: float  # relative, at the end
    iterations: int


@dataclass(kw_only=True, eq=False, repr=False)
class ShapeMethod(Method):
    """A method whose structure is that of one shape step, :meth:`_fit`, perhaps cut to a rank afterwards.

    Parameters
    ----------
    rank : int or None
        Cut the F x 3P structure to this rank afterwards.
    """

    provides = frozenset({"structure"})
    handles_gaps = True

    rank: int | None = None

    def reconstruct(self, observations: Observations, n_bodies: int | None = 1) -> Reconstruction:
        """See :meth:`nrsfm.methods.base.Method.reconstruct`; the number of bodies plays no part."""
        self._check_settings()
        if self.rank is not None:
            base.check_count(self, "rank")
        cameras, visible = observations.required_cameras(), observations.visible
        data = base.standardise(observations.tracks, visible)
        observations.stage("structure")
        S = self._fit(data.W, cameras, visible, observations.progress)
        S = S if self.rank is None else cut_rank(S, self.rank)
        return Reconstruction(structure=S * data.scale, cameras=cameras)

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """Bytes of ten arrays of 3F x P, as measured for BMM."""
        return 8.0 * 10 * 3 * n_frames * n_points

    @abstractmethod
    def _check_settings(self) -> None:
        """Raise MethodError if a hyper-parameter is wrong."""

    @abstractmethod
    def _fit(self, W: Array, cameras: Array, visible: Mask | None, progress: Progress | None) -> Array:
        """The (F, 3, P) structure of centred tracks."""


@dataclass(kw_only=True, eq=False, repr=False)
class BMM(ShapeMethod):
    """min |S#|_* + 1/(2 l2) |W - R S|^2 with given cameras; l2 = 0 demands R S = W.

    Parameters
    ----------
    l2 : float
        Weight of the nuclear norm against the data term in standardised units; 0 is the noise-free limit.
    rank : int or None
        Cut the F x 3P structure to this rank afterwards, as the authors' K.
    tol : float
        Stop when the relative primal and dual residuals are below it.
    """

    l2: float = 0.0
    max_iter: int = 6000
    tol: float = 1e-4

    def _check_settings(self) -> None:
        base.check_at_least(self, 0, "l2")
        base.check_count(self, "max_iter")
        base.check_positive(self, "tol")

    def _fit(self, W: Array, cameras: Array, visible: Mask | None, progress: Progress | None) -> Array:
        fitted = fit_shape(W, cameras, self.l2, visible, max_iter=self.max_iter, tol=self.tol, progress=progress)
        return fitted.structure


def fit_shape(
    W: Array,
    cameras: Array,
    l2: float = 0.0,
    visible: Mask | None = None,
    *,
    max_iter: int = 6000,
    tol: float = 1e-4,
    progress: Progress | None = None,
) -> ShapeFit:
    """The shape step of the block matrix method, by ADMM on the split S# = g(S).

    With V = S# + Y/b the S-step is S = V + R'(W - R V) / (1 + b l2) because R R' = I; for l2 = 0 it is the projection
    onto R S = W. Where tracks have gaps, the residual W - R V is :func:`nrsfm.methods.gaps.misfit`: hidden points keep
    V, and each frame has its own translation; both are exact minimisers. The S#-step is a singular value threshold at
    1/b. One iteration costs a threshold, O(F^2 3P).

    Parameters
    ----------
    W : (F, 2, P) array
        Centred tracks; 0 where they have a gap.
    cameras : (F, 2, 3) array
    l2 : float
        Weight of the nuclear norm; the objective is l2 |S#|_* + 1/2 |W - R S|^2, or |S#|_* under R S = W when 0.
    visible : (F, P) bool array, optional
    tol : float
        Relative size of the primal and dual residuals to stop at.

    Raises
    ------
    MethodError
        If l2 is negative.
    """
    if not l2 >= 0:
        raise MethodError(f"l2 is {l2}, wanted a number >= 0")
    F, _, P = W.shape
    Rt = cameras.transpose(0, 2, 1)
    S = Rt @ W
    Z = S.copy()
    Y = np.zeros_like(S)  # scaled multiplier of g(S) = S#, Y/b
    size = max(float(np.linalg.norm(W)), TINY)
    norm = 0.0
    admm = Admm(max_iter, tol, 20.0 / float(np.linalg.norm(S.reshape(F, 3 * P), 2)), progress=progress)
    for b in admm:
        V = Z + Y
        S = V + Rt @ misfit(W, cameras @ V, visible) / (1 + b * l2)
        S_relaxed = 1.6 * S + (1 - 1.6) * Z  # over-relaxation
        before = Z
        flat, norm = singular_value_threshold((S_relaxed - Y).reshape(F, 3 * P), 1 / b)
        Z = flat.reshape(F, 3, P)
        Y += Z - S_relaxed
        Y /= admm.balance(float(np.linalg.norm(Z - S)) / size, float(np.linalg.norm(Z - before)) / size)
    return ShapeFit(S, Z, b * Y, b, norm, admm.residual, admm.iteration)


def cut_rank(structure: Array, rank: int) -> Array:
    """Nearest (F, 3, P) structure with rank(S#) <= K for its F x 3P arrangement S# (Eckart, Young 1936)."""
    F, _, P = structure.shape
    if not rank >= 1:
        raise MethodError(f"rank is {rank}, wanted at least 1")
    U, s, Vt = np.linalg.svd(structure.reshape(F, 3 * P), full_matrices=False)
    cut: Array = ((U[:, :rank] * s[:rank]) @ Vt[:rank]).reshape(F, 3, P)
    return cut
