"""Cameras and structure of one objective: cameras that turn smoothly, before structure that moves smoothly.

    min over R, S   l2 |L S#|_* + 1/2 |W - R S|^2 + P u^4/2 sum_f |D_{f+1} - D_f|^2,   D_f = Q_f'Q_{f+1}

L is that of :mod:`nrsfm.methods.structure.smooth_bmm` with t frames. Q_f is camera R_f completed to a rotation and D_f
its turn to the next frame, so that uniform turning is free, and u frames are about what is left of the tracks' say
against it. Structure alone does not fix the cameras: a body that sways before a steady camera and a swaying camera
before a steady body give the same tracks.

The norm is written as a product (Srebro, Rennie, Jaakkola, NIPS 2004): L S# = A B of rank r costs the least
(|A|^2 + |B|^2)/2. For given A and cameras B solves a ridge regression, so it is eliminated (variable projection: Golub,
Pereyra, SIAM J. Numer. Anal. 1973), and A and the cameras' rotation vectors descend together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.optimize import minimize

from nrsfm.methods.base import Array, MethodError, standardise
from nrsfm.methods.numerics.linear import axes
from nrsfm.methods.structure.pta import trajectory_basis
from nrsfm.methods.structure.smooth_bmm import SMOOTHING, Smoothness, fit_smooth

#: Frames over which cameras turn uniformly.
TURNING = 10.0
#: Noise of the tracks that is allowed for, in parts of their spread.
NOISE = 0.01
#: Rank r of the structure.
RANK = 30
#: Length of a unit step of a camera, in radians.
STEP = 0.1


@dataclass(frozen=True)
class Refinement:
    """(F, 2, 3) cameras, and the objective at the start and after every iteration."""

    cameras: Array
    objective: Array


@dataclass(frozen=True)
class Objective:
    """The module's objective by rotation vectors w (F, 3) and A (F, r); cameras are R_f exp(w_f)."""

    W: Array  # centred tracks, (F, 2, P)
    cameras: Array  # (F, 2, 3)
    l2: float  # weight of the nuclear norm
    turning: float = TURNING  # u
    smoothing: float = SMOOTHING  # t

    def frequencies(self) -> tuple[Array, Array]:
        """Cosines T (F, F), and the eigenvalue of D'D (F,) that belongs to each of its columns."""
        F = len(self.W)
        return trajectory_basis(F, F), 4 * np.sin(np.pi * np.arange(F) / (2 * F)) ** 2

    def __call__(self, w: Array, A: Array) -> tuple[float, Array, Array]:
        """The objective, and its gradient with respect to w and A."""
        F, _, P = self.W.shape
        T, d = self.frequencies()
        inverse = T * np.sqrt((1 + self.smoothing**2) / (1 + self.smoothing**2 * d))  # of L
        R = self.cameras @ rotations(w)
        V = inverse @ A
        M = (R[:, :, None, :] * V[:, None, :, None]).reshape(2 * F, -1)  # W is M B with B (3r, P)
        W = self.W.reshape(2 * F, P)
        gram = M.T @ M
        gram[np.diag_indices(len(gram))] += self.l2
        B = scipy.linalg.solve(gram, M.T @ W, assume_a="pos", check_finite=False)
        E = W - M @ B
        turn, by_turn = unsteadiness(axes(R))
        weight = 0.5 * P * self.turning**4
        value = 0.5 * self.l2 * float(np.sum(A**2) + np.sum(B**2)) + 0.5 * float(np.sum(E**2)) + weight * turn
        by_M = -(E @ B.T).reshape(F, 2, -1, 3)
        by_R = np.einsum("firk,fr->fik", by_M, V)
        by_A = inverse.T @ np.einsum("firk,fik->fr", by_M, R) + self.l2 * A
        by_w = axial(R.transpose(0, 2, 1) @ by_R) + weight * by_turn
        return value, np.einsum("fji,fj->fi", turns_of(w), by_w), by_A


def refine_cameras(
    tracks: Array,
    cameras: Array,
    *,
    turning: float = TURNING,
    smoothing: float = SMOOTHING,
    noise: float = NOISE,
    iterations: int = 200,
) -> Refinement:
    """The module's program, by limited-memory BFGS from given cameras and the structure that :func:`fit_smooth` gives.

    Unknowns are the cosines of w and A, each in the size that its term of the objective leaves to it. An iteration
    costs O(F r (P + r)). The weight is l2 = 2 ``noise`` (sqrt(F) + sqrt(3P)), of which noise stays below.

    Parameters
    ----------
    tracks : (F, 2, P) array
    cameras : (F, 2, 3) array
    turning, smoothing : float
        u and t, in frames.
    noise : float
        In parts of the tracks' spread.
    iterations : int
        At most.

    Raises
    ------
    MethodError
        If a setting is not a number, or not positive.
    """
    settings = {"turning": turning, "smoothing": smoothing, "noise": noise, "iterations": iterations}
    for name, value in settings.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < np.inf:
            raise MethodError(f"cameras.{name} is {value!r}, wanted a number > 0")
    W = standardise(tracks).W
    F, _, P = W.shape
    l2 = 2 * noise * (np.sqrt(F) + np.sqrt(3 * P))
    objective = Objective(W, cameras, l2, turning, smoothing)
    T, d = objective.frequencies()
    S = fit_smooth(W, Smoothness(cameras, smoothing), l2, tol=1e-3).structure.reshape(F, -1)
    U, s, _ = np.linalg.svd(np.sqrt((1 + smoothing**2 * d) / (1 + smoothing**2))[:, None] * (T.T @ S))
    A = U[:, :RANK] * np.sqrt(s[:RANK])
    sizes = STEP / np.sqrt(1 + turning**4 * d**2)
    scale = 1 / np.sqrt(1 + smoothing**2)
    n = 3 * F
    history: list[float] = []

    def unpack(x: Array) -> tuple[Array, Array]:
        return T @ (sizes[:, None] * x[:n].reshape(F, 3)), x[n:].reshape(A.shape) * scale

    def values(x: Array) -> tuple[float, Array]:
        value, by_w, by_A = objective(*unpack(x))
        return value, np.concatenate([(sizes[:, None] * (T.T @ by_w)).ravel(), scale * by_A.ravel()])

    x = np.concatenate([np.zeros(n), A.ravel() / scale])
    history.append(values(x)[0])
    found = minimize(
        values,
        x,
        jac=True,
        method="L-BFGS-B",
        callback=lambda intermediate_result: history.append(float(intermediate_result.fun)),
        options={"maxiter": iterations, "maxcor": 30},
    )
    return Refinement(cameras @ rotations(unpack(found.x)[0]), np.array(history))


def unsteadiness(Q: Array) -> tuple[float, Array]:
    """Sum of |D_{f+1} - D_f|^2 for (F, 3, 3) rotations Q_f exp([w_f]), and its gradient by w (F, 3) at w = 0."""
    D = Q[:-1].transpose(0, 2, 1) @ Q[1:]
    change = np.diff(D, axis=0)
    by_D = np.zeros_like(D)
    by_D[1:] += 2 * change
    by_D[:-1] -= 2 * change
    by_w = np.zeros((len(Q), 3))
    by_w[1:] += axial(D.transpose(0, 2, 1) @ by_D)
    by_w[:-1] -= axial(by_D @ D.transpose(0, 2, 1))
    return float(np.sum(change**2)), by_w


def axial(M: Array) -> Array:
    """v (F, 3) with v.w = <M, [w]> for every w, M (F, 3, 3), [w] the matrix of the cross product with w."""
    v: Array = np.stack([M[:, 2, 1] - M[:, 1, 2], M[:, 0, 2] - M[:, 2, 0], M[:, 1, 0] - M[:, 0, 1]], axis=1)
    return v


def cross(w: Array) -> Array:
    """The (F, 3, 3) matrices [w] of the cross products with (F, 3) vectors."""
    matrices: Array = np.cross(np.eye(3), w[:, None])
    return -matrices.transpose(0, 2, 1)


def rotations(w: Array) -> Array:
    """exp([w]), (F, 3, 3), by Rodrigues' formula."""
    angle = np.linalg.norm(w, axis=1)[:, None, None]
    k = cross(w)
    rotated: Array = np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (k @ k)
    return rotated


def turns_of(w: Array) -> Array:
    """J (F, 3, 3) with exp([w + dw]) = exp([w]) exp([J dw]) to first order."""
    angle = np.linalg.norm(w, axis=1)[:, None, None]
    k = cross(w)
    small = angle < 1e-3
    square = np.where(small, 1.0, angle) ** 2
    third = np.where(small, 1 / 6, (1 - np.sinc(angle / np.pi)) / square)
    matrices: Array = np.eye(3) - 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * k + third * (k @ k)
    return matrices
