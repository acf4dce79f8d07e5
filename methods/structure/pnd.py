"""Non-rigid structure from motion with a Procrustean normal distribution, by expectation maximisation.

Shapes X_f in the camera's frame, aligned to a mean shape m by a rotation R_f and a scale s_f, are normal with a
covariance Sigma in the directions that neither turn nor scale m, and flat in the others. No rank or weight is chosen.

Lee, Cho, Choi, Oh, "Procrustean normal distribution for non-rigid structure from motion", CVPR 2013, PAMI 2017.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from nrsfm.methods import base
from nrsfm.methods.base import Array, Method, Observations, Progress, Reconstruction
from nrsfm.methods.numerics.linear import axes
from nrsfm.methods.structure.bmm import cut_rank

#: Variance of the noise, of the covariance's diagonal, and the step along the gradient to start from; |X_f| is about 1.
NOISE, RIDGE, STEP = 1e-4, 1e-4, 1e-4


@dataclass(kw_only=True, eq=False, repr=False)
class PND(Method):
    """Procrustean normal distribution; the cameras are where it starts, and it gives its own in their world.

    Parameters
    ----------
    rank : int or None
        Cut the F x 3P structure to this rank afterwards.
    max_iter : int
    tol : float
        Stop when an iteration lowers the objective, in nats a frame and dimension, by less. It falls for very long, so
        that this decides the result.
    """

    provides = frozenset({"structure"})

    rank: int | None = None
    max_iter: int = 1000
    tol: float = 5e-2

    def reconstruct(self, observations: Observations, n_bodies: int | None = 1) -> Reconstruction:
        """See :meth:`nrsfm.methods.base.Method.reconstruct`; the number of bodies plays no part."""
        base.check_count(self, "max_iter")
        base.check_positive(self, "tol")
        if self.rank is not None:
            base.check_count(self, "rank")
        cameras = observations.required_cameras()
        data = base.standardise(observations.tracks)
        observations.stage("structure")
        X, R = self._fit(data.W, cameras, observations.progress)
        S = R @ X if self.rank is None else cut_rank(R @ X, self.rank)
        return Reconstruction(structure=S * data.scale, cameras=R.transpose(0, 2, 1)[:, :2])

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """Bytes of four moments of all frames, each of 3P x 3P."""
        return 8.0 * 4 * n_frames * (3 * n_points) ** 2

    def _fit(self, W: Array, cameras: Array, progress: Progress | None) -> tuple[Array, Array]:
        """Shapes (F, 3, P) in the camera's frame, and the rotations (F, 3, 3) that turn them to the world."""
        P = W.shape[2]
        T = scipy.linalg.null_space(np.ones((1, P)))  # without the translation, (P, p)
        D = (W @ T).transpose(0, 2, 1)  # (F, p, 2)
        c = 3 * P - 7
        lifted = lift(D, cameras)
        size = float(np.sqrt(np.mean(np.sum(lifted**2, axis=(1, 2)))))
        lifted, D, v = lifted / size, D / size, NOISE
        m = mean_shape(lifted)
        found = fit(Moments(lifted, lifted[..., None, None] * lifted[:, None, None]), m, RIDGE)
        step, lowest = STEP, np.inf
        for iteration in range(1, self.max_iter + 1):
            X, v = expected(D, found, v)
            m, found, step = descend(X, m, step)
            objective = (2 * found.cost + 2 * (P - 1) * np.log(v)) / c
            fall, lowest = lowest - objective, objective
            if progress is not None:
                progress(iteration, self.max_iter, {"objective": float(objective)})
            if fall < self.tol:
                break
        R = found.alignment.rotations
        U, _, Vt = np.linalg.svd(np.einsum("fij,fjk->ik", R[:, :, :2], cameras))
        return size * (T @ X.shapes).transpose(0, 2, 1), (U @ Vt).T @ R  # in the world of the cameras given


@dataclass(frozen=True)
class Alignment:
    """Shapes turned and scaled to a mean: Y_f = s_f R_f X_f with <m, Y_f> = 1 and Y_f m' symmetric."""

    shapes: Array  # Y, (F, p, 3)
    rotations: Array  # R, (F, 3, 3)
    scales: Array  # s, (F,)


def align(X: Array, m: Array) -> Alignment:
    """Align (F, p, 3) shapes to the mean (p, 3) of length 1; as the authors do, reflections too."""
    U, D, Vt = np.linalg.svd(np.einsum("fpi,pj->fij", X, m))
    R = (U @ Vt).transpose(0, 2, 1)
    s = 1 / D.sum(axis=1)
    return Alignment(s[:, None, None] * np.einsum("fij,fpj->fpi", R, X), R, s)


def tangents(m: Array) -> Array:
    """N (3p, 4): the directions in which scaling and turning move m."""
    turned = [np.cross(e, m) for e in np.eye(3)]
    return np.stack([m, *turned], axis=2).reshape(-1, 4)


@dataclass(frozen=True)
class Moments:
    """Second moments (F, p, 3, p, 3) of shapes (F, p, 3) about 0, both of some frame of reference."""

    shapes: Array
    seconds: Array

    def turned(self, T: Array) -> Moments:
        """All shapes mapped by (F, 3, 3) matrices."""
        F, p, _ = self.shapes.shape
        half = T[:, None] @ self.seconds.reshape(F, p, 3, 3 * p)
        whole = half.reshape(F, 3 * p * p, 3) @ T.transpose(0, 2, 1)
        return Moments(self.shapes @ T.transpose(0, 2, 1), whole.reshape(F, p, 3, p, 3))


@dataclass(frozen=True)
class Distribution:
    """The distribution for a mean, and how well it fits."""

    alignment: Alignment
    precision: Array  # Q Sigma^-1 Q', (3p, 3p)
    cost: float  # 1/2 log det Sigma - c mean log s
    gradient: Array  # by m, (p, 3)
    moments: Moments


def fit(X: Moments, m: Array, ridge: float = 0.0) -> Distribution:
    """Sigma for a mean m and the objective's gradient along the sphere |m| = 1.

    Moving m by dm moves the alignment by Y -> (1 + a)(I + [w]) Y with a = -<dm, Y> and
    w = (tr(B) I - B)^-1 sum_p y_p x dm_p, B = Y m'.
    """
    F, p, _ = X.shapes.shape
    found = align(X.shapes, m)
    Y = found.shapes
    moved = X.turned(found.scales[:, None, None] * found.rotations)
    H = moved.seconds.mean(axis=0).reshape(3 * p, 3 * p) + ridge * np.eye(3 * p)
    N = tangents(m)
    Q = scipy.linalg.qr(N)[0][:, 4:]
    c = 3 * p - 4
    factor = scipy.linalg.cho_factor(Q.T @ H @ Q, lower=True)
    E = Q @ scipy.linalg.cho_solve(factor, Q.T)
    cost = float(np.log(np.diag(factor[0])).sum() - c * np.log(found.scales).mean())
    gamma = (E @ H @ np.linalg.pinv(N).T).reshape(p, 3, 4)
    gradient = -gamma[:, :, 0] - sum(np.cross(gamma[:, :, i + 1], e) for i, e in enumerate(np.eye(3)))
    rows = moved.seconds.transpose(1, 0, 2, 3, 4).reshape(p, 3 * F, 3 * p)
    D = (rows @ E.reshape(3 * p, p, 3).transpose(1, 0, 2)).sum(axis=0).reshape(F, 3, 3)  # sum_p (H E)_pp
    trace = np.trace(D, axis1=1, axis2=2)
    tau = np.stack([D[:, 1, 2] - D[:, 2, 1], D[:, 2, 0] - D[:, 0, 2], D[:, 0, 1] - D[:, 1, 0]], axis=1)
    B = np.einsum("fpi,pj->fij", Y, m)
    w = np.linalg.solve(np.trace(B, axis1=1, axis2=2)[:, None, None] * np.eye(3) - B, tau[:, :, None])[:, :, 0]
    gradient = gradient - np.einsum("f,fpi->pi", trace - c, Y) / F + np.cross(w[:, None], Y).mean(axis=0)
    gradient = gradient - np.sum(gradient * m) * m
    return Distribution(found, E, cost, gradient, moved)


def descend(X: Moments, m: Array, step: float) -> tuple[Array, Distribution, float]:
    """M-step: one step of the mean against the gradient, halved until the cost falls enough (Armijo's rule).

    Returned with the step to try next, twice as long if the first was accepted.
    """
    before = fit(X, m)
    slope, first = float(np.sum(before.gradient**2)), step
    while True:
        trial = m - step * before.gradient
        trial /= np.linalg.norm(trial)
        found = fit(X, trial)
        if found.cost <= before.cost - 1e-4 * step * slope:
            return trial, found, 2 * step if step == first else step
        if step < 1e-12:
            return m, before, step
        step /= 2


def expected(D: Array, model: Distribution, v: float) -> tuple[Moments, float]:
    """E-step: moments of the shapes given (F, p, 2) images without translation, and the variance of the noise for them.

    The variance may fall to twice its new value at most, so that the noise does not vanish before the shapes settle.
    """
    F, p, _ = D.shape
    R, s = model.alignment.rotations, model.alignment.scales
    seen = np.tile([1.0, 1.0, 0.0], p)
    images = np.pad(D, ((0, 0), (0, 0), (0, 1))).reshape(F, 3 * p)
    X, seconds, left = np.empty((F, 3 * p)), np.empty((F, 3 * p, 3 * p)), 0.0
    for f in range(F):  # a frame at a time stays in the cache
        G = s[f] * R[f]
        half = (model.precision.reshape(-1, 3) @ G).reshape(3 * p, 3 * p)
        A = v * (half.T.reshape(-1, 3) @ G).reshape(3 * p, 3 * p)
        A[np.diag_indices(3 * p)] += seen
        C = inverse(A)
        X[f] = C @ images[f]
        C *= v
        left += float(np.sum((images[f] - seen * X[f]) ** 2) + seen @ np.diag(C))
        np.multiply(X[f][:, None], X[f], out=seconds[f])
        seconds[f] += C
    new = float(left) / D.size
    moments = Moments(X.reshape(F, p, 3), seconds.reshape(F, p, 3, p, 3))
    return moments, max(1e-10, min(2 * new, max(v, new)))


def inverse(A: Array) -> Array:
    """The inverse of a symmetric positive definite matrix, which is overwritten, by its Cholesky factor."""
    factor, _ = scipy.linalg.lapack.dpotrf(A.T, lower=1, overwrite_a=1)
    half, _ = scipy.linalg.lapack.dpotri(factor, lower=1, overwrite_c=1)
    whole: Array = np.tril(half)
    whole += np.tril(half, -1).T
    return whole


def lift(D: Array, cameras: Array) -> Array:
    """Shapes (F, p, 3) in the camera's frame with the depth of the rigid shape mu that leaves the least variance.

    (I - mean r3 r3') mu = mean_f R_f' D_f, and depth is r3' mu.
    """
    Q = axes(cameras)
    r3 = Q[:, 2]
    A = np.eye(3) - np.einsum("fi,fj->ij", r3, r3) / len(r3)
    mu = np.linalg.pinv(A, rcond=1e-9) @ np.einsum("fij,fpi->jp", cameras, D) / len(r3)
    return np.concatenate([D, (r3 @ mu)[:, :, None]], axis=2)


def mean_shape(X: Array, *, max_iter: int = 1000, tol: float = 1e-12) -> Array:
    """Generalised Procrustes analysis: the mean (p, 3), of length 1, of (F, p, 3) shapes aligned to it."""
    m: Array = X[0] / np.linalg.norm(X[0])
    for _ in range(max_iter):
        new = align(X, m).shapes.mean(axis=0)
        new /= np.linalg.norm(new)
        change, m = float(np.linalg.norm(new - m)), new
        if change < tol:
            break
    return m
