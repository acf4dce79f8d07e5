"""Single-body non-rigid structure from motion for bodies that move smoothly: BMM with an order of the frames.

    min over S   |L S#|_* + 1/(2 l2) |W - R S|^2,   L'L = (I + t^2 D'D) / (1 + t^2)

D (F - 1, F) takes differences of successive frames. The norm depends on L by L'L alone, so L is its bidiagonal factor.
t = 0 is the block matrix method (:mod:`nrsfm.methods.structure.bmm`). For large t the norm is that of the points'
velocities: structure at rest is free, and each motion counts the more the faster it changes. A camera that turns sees
a point from many sides before it has moved far, which low rank alone does not use. Before a camera at rest depth is 0
as without the prior.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from nrsfm.methods import base
from nrsfm.methods.base import Array, Mask, MethodError, Progress
from nrsfm.methods.gaps import misfit
from nrsfm.methods.numerics.admm import Admm
from nrsfm.methods.numerics.linear import TINY
from nrsfm.methods.numerics.proximal import singular_value_threshold
from nrsfm.methods.structure.bmm import BMM, ShapeFit

#: Frames over which structure keeps still.
SMOOTHING = 30.0
#: Penalty of U = R S in parts of that of Z = L S: a larger one is faster on whole tracks, a smaller one in gaps.
IMAGES = 4.0


@dataclass(frozen=True)
class Smoothness:
    """L of the module's formula and the solver of the S-step, before (F, 2, 3) cameras. Everything is O(F) a point."""

    cameras: Array
    smoothing: float = SMOOTHING  # t, in frames

    @cached_property
    def _gram(self) -> tuple[Array, float]:
        """The diagonal of L'L, (F,), and the entries beside it."""
        F, scale = len(self.cameras), 1 + self.smoothing**2
        neighbours = np.full(F, 2.0)
        neighbours[[0, -1]] -= 1
        return (1 + self.smoothing**2 * neighbours) / scale, -(self.smoothing**2) / scale

    @cached_property
    def _L(self) -> tuple[Array, Array]:
        """The diagonal of L, (F,), and the entries above it, (F - 1,), for (F, 3, P) arrays."""
        diagonal, beside = self._gram
        lower = np.stack([diagonal, np.full(len(diagonal), beside)])
        factor = scipy.linalg.cholesky_banded(lower, lower=True)
        return factor[0, :, None, None], factor[1, :-1, None, None]

    @cached_property
    def _factor(self) -> Array:
        """Cholesky factor of L'L x I_3 + k R'R, k = IMAGES, a band of three entries below the diagonal."""
        diagonal, beside = self._gram
        blocks = IMAGES * self.cameras.transpose(0, 2, 1) @ self.cameras + diagonal[:, None, None] * np.eye(3)
        band = np.zeros((4, 3 * len(diagonal)))
        for row in range(3):
            for column in range(row + 1):
                band[row - column, column::3] = blocks[:, row, column]
        band[3] = beside
        return np.asarray(scipy.linalg.cholesky_banded(band, lower=True, overwrite_ab=True))

    def apply(self, S: Array) -> Array:
        """L S for an (F, 3, P) structure."""
        diagonal, above = self._L
        product: Array = diagonal * S
        product[:-1] += above * S[1:]
        return product

    def apply_transposed(self, Z: Array) -> Array:
        """L'Z for an (F, 3, P) array."""
        diagonal, above = self._L
        product: Array = diagonal * Z
        product[1:] += above * Z[:-1]
        return product

    def structure(self, Z: Array, U: Array) -> Array:
        """S (F, 3, P) that minimises |L S - Z|^2 + k |R S - U|^2: (L'L x I_3 + k R'R) S = L'Z + k R'U."""
        F, _, P = Z.shape
        right = self.apply_transposed(Z) + IMAGES * self.cameras.transpose(0, 2, 1) @ U
        S: Array = scipy.linalg.cho_solve_banded((self._factor, True), right.reshape(3 * F, P), check_finite=False)
        return S.reshape(F, 3, P)


@dataclass(frozen=True)
class SmoothFit(ShapeFit):
    """Solution of :func:`fit_smooth`; the shape is Z. U has a multiplier of its own, with the penalty k b."""

    images: Array  # U, (F, 2, P)
    images_multiplier: Array  # of U = R S, (F, 2, P)


@dataclass(kw_only=True, eq=False, repr=False)
class SmoothBMM(BMM):
    """min |L S#|_* + 1/(2 l2) |W - R S|^2 with given cameras; l2 = 0 demands R S = W.

    Parameters
    ----------
    smoothing : float
        t of L, in frames; 0 is BMM.
    l2, rank, max_iter, tol
        Those of :class:`nrsfm.methods.structure.bmm.BMM`.
    """

    smoothing: float = SMOOTHING

    def _check_settings(self) -> None:
        super()._check_settings()
        base.check_at_least(self, 0, "smoothing")

    def _fit(self, W: Array, cameras: Array, visible: Mask | None, progress: Progress | None) -> Array:
        smoothness = Smoothness(cameras, self.smoothing)
        fitted = fit_smooth(W, smoothness, self.l2, visible, max_iter=self.max_iter, tol=self.tol, progress=progress)
        return fitted.structure

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """Bytes of fifteen arrays of 3F x P, as measured."""
        return 8.0 * 15 * 3 * n_frames * n_points


def fit_smooth(
    W: Array,
    smoothness: Smoothness,
    l2: float = 0.0,
    visible: Mask | None = None,
    *,
    max_iter: int = 6000,
    tol: float = 1e-4,
    progress: Progress | None = None,
) -> SmoothFit:
    """The module's program, by ADMM on the splits Z = L S and U = R S with penalties b and k b.

    The S-step is one banded system whose factor serves all iterations. Z is a singular value threshold at 1/b. U is in
    closed form, (W + b k l2 V) / (1 + b k l2) for V = R S + Y/(k b); where tracks have gaps, hidden points keep V and
    each frame has its own translation. An iteration costs a threshold, O(F^2 3P).

    Parameters
    ----------
    W : (F, 2, P) array
        Centred tracks; 0 where they have a gap.
    smoothness : Smoothness
    l2 : float
        Weight of the nuclear norm; the objective is l2 |L S#|_* + 1/2 |W - R S|^2, or |L S#|_* under R S = W when 0.
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
    R = smoothness.cameras
    S = R.transpose(0, 2, 1) @ W
    Z, U = smoothness.apply(S), W
    Y, Y_images = np.zeros_like(Z), np.zeros_like(U)  # scaled multipliers
    size = max(float(np.linalg.norm(Z)), TINY)
    norm = 0.0

    def distance(Z_gap: Array, U_gap: Array) -> float:
        return float(np.sqrt(np.sum(Z_gap**2) + IMAGES * np.sum(U_gap**2))) / size

    admm = Admm(max_iter, tol, 20.0 / max(float(np.linalg.norm(Z.reshape(F, -1), 2)), TINY), progress=progress)
    for b in admm:
        S = smoothness.structure(Z + Y, U + Y_images)
        LS, RS = smoothness.apply(S), R @ S
        Z_relaxed, U_relaxed = 1.6 * LS + (1 - 1.6) * Z, 1.6 * RS + (1 - 1.6) * U  # over-relaxation
        before = Z, U
        flat, norm = singular_value_threshold((Z_relaxed - Y).reshape(F, 3 * P), 1 / b)
        Z, V = flat.reshape(F, 3, P), U_relaxed - Y_images
        U = V + misfit(W, V, visible) / (1 + b * IMAGES * l2)
        Y += Z - Z_relaxed
        Y_images += U - U_relaxed
        factor = admm.balance(distance(Z - LS, U - RS), distance(Z - before[0], U - before[1]))
        Y /= factor
        Y_images /= factor
    S = S + R.transpose(0, 2, 1) @ (U - R @ S)
    b = admm.penalty
    return SmoothFit(S, Z, b * Y, b, norm, admm.residual, admm.iteration, U, IMAGES * b * Y_images)
