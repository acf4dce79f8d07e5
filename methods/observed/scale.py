"""The scale of the image in each frame, from tracks and cameras: weak perspective, w_f = s_f R_f S_f + t_f.

The difference of two tracks that keep their distance, in axes that turn with nothing but the camera, is the image of
one point at rest, times s_f. Other pairs move; which is not known. Each pair's 3D motion is taken for a Gaussian
process of unknown strength: rest, slow drift, and what is left. The likelihood without the strengths is

    min over u   sum over pairs  log |u y|^2_K   s.t.  sum over f of log u_f = 0,   u = 1 / s

with y (2F,) the pair's image track and K the inverse covariance of the process. A pair at rest decides, one that moves
has no say. Multiplying the tracks by any s moves the minimum by exactly s, so real deformation gives the same error
with zoom and without.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from nrsfm.methods.base import Array
from nrsfm.methods.structure.pta import trajectory_basis

#: Cosines that make up a pair's drift, the k-th with variance 1/k^2 in each coordinate; faster ones are all one.
DRIFT = 5
#: Variance of what is left of a pair's motion, in parts of that of the strongest drift.
REST = 0.1
#: Motion of a pair, in parts of the scene's spread, below which pairs are equally rigid.
RIGID = 1e-3
#: A gain below it is no evidence for a change of scale: see :func:`estimate_scales`.
SIGNIFICANT = 0.15
#: Pairs are made from at most so many tracks, evenly spread over all.
MOST_TRACKS = 300


@dataclass(frozen=True, eq=False)
class Scales:
    """The (F,) scales of geometric mean 1, and the gain: the mean over pairs of the fall of log |u y|^2_K."""

    scales: Array
    gain: float

    @property
    def significant(self) -> bool:
        """Whether the scales explain more of the pairs' motion than deformation at one scale does."""
        return self.gain > SIGNIFICANT


def estimate_scales(tracks: Array, cameras: Array, *, max_iter: int = 30, tol: float = 1e-4) -> Scales:
    """Scales of (F, 2, P) tracks without gaps before (F, 2, 3) orthographic cameras.

    Iteratively reweighted: a pair's weight is 1/|u y|^2_K, and the u of fixed weights solves M u = 1/u, whose objective
    u'M u / 2 - sum of log u_f is self-concordant, by damped Newton steps (Nesterov, Nemirovskii 1994). An iteration
    costs O(F^3 + F^2 P).

    The gain tells zoom from deformation. Before cameras of one scale it is at most .04 on the eight pairs, with the
    bodies' own motion or without, .06 for two dancers who walk about, and .12 where cameras are estimated, slow or at
    rest; a zoom of 10 % gives .15 to .72.
    """
    F, _, P = tracks.shape
    chosen = tracks[:, :, np.linspace(0, P - 1, min(P, MOST_TRACKS)).astype(int)]
    W = (chosen - chosen.mean(axis=2, keepdims=True)).reshape(2 * F, -1)
    V = _unpunished(cameras)
    pairs = np.triu_indices(W.shape[1], 1)
    least = RIGID**2 * float(np.mean(W**2))
    K = np.eye(2 * F) - V @ V.T

    def energies(u: Array) -> Array:
        """|u y|^2_K of all pairs, (P, P), and the least motion."""
        Y = np.repeat(u, 2)[:, None] * W
        Z = V.T @ Y
        G = Y.T @ Y - Z.T @ Z
        d = np.diag(G)
        return np.asarray(np.maximum(d[:, None] + d - 2 * G, 0) + least * (u @ u))

    u = np.ones(F)
    first = current = energies(u)
    for _ in range(max_iter):
        weights = 1 / current
        np.fill_diagonal(weights, 0)
        weights /= weights.sum()
        laplacian = np.diag(weights.sum(axis=1)) - weights
        M = (K * (W @ laplacian @ W.T)).reshape(F, 2, F, 2).sum(axis=(1, 3)) + least / 2 * np.eye(F)
        before, u = u, _balanced(M * (F / float(u @ M @ u)), u)
        current = energies(u)
        if np.abs(np.log(u / before)).max() < tol:
            break
    return Scales(1 / u, float(np.log(first[pairs] / current[pairs]).mean()))


def _unpunished(cameras: Array) -> Array:
    """V (2F, k) with K = I - V V': images of points at rest, and of drift as far as its prior lets it pass."""
    F = len(cameras)
    at_rest = scipy.linalg.orth(cameras.reshape(2 * F, 3))
    n = min(DRIFT, F - 1)
    theta = trajectory_basis(F, n + 1)[:, 1:] / np.arange(1, n + 1)
    images = np.einsum("fij,fk->fikj", cameras, theta).reshape(2 * F, 3 * n)
    images -= at_rest @ (at_rest.T @ images)
    Q, strength, _ = scipy.linalg.svd(images, full_matrices=False)
    variance = (strength / strength[0]) ** 2
    return np.hstack([at_rest, Q * np.sqrt(variance / (variance + REST))])


def _balanced(M: Array, u: Array) -> Array:
    """u > 0 with M u = 1/u, scaled to geometric mean 1, for a positive semidefinite M; from a first guess."""
    for _ in range(50):
        gradient = M @ u - 1 / u
        step = scipy.linalg.solve(M + np.diag(u**-2), gradient, assume_a="pos")
        decrement = float(np.sqrt(max(gradient @ step, 0)))
        u = u - step / (1 + decrement)
        if decrement < 1e-6:
            break
    balanced: Array = u / np.exp(np.log(u).mean())
    return balanced
