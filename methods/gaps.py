"""Tracks with gaps: what is not observed counts in no residual, and is filled in only where a method needs it whole.

An orthographic image fixes structure up to a translation t_f of each frame. Without gaps t_f is the centroid; with gaps
it is unknown, so that residuals are taken after the translation that suits the visible points best.
"""

from __future__ import annotations

import numpy as np

from nrsfm.methods.base import Array, Mask, check_gaps
from nrsfm.methods.numerics.proximal import singular_value_threshold


def misfit(W: Array, X: Array, visible: Mask | None) -> Array:
    """W - X - t 1' where visible and 0 elsewhere, t (F, 2) the best translation; W - X for visible = None.

    t_f is the mean of W - X over the visible points of frame f.
    """
    if visible is None:
        return W - X
    D = np.where(visible[:, None], W - X, 0)
    t = D.sum(axis=2, keepdims=True) / visible.sum(axis=1)[:, None, None]
    return np.where(visible[:, None], D - t, 0)


def enough(visible: Mask) -> Mask:
    """A mask that also takes completed positions for seen, in frames of which it sees fewer than two points.

    For a cluster of tracks that are hidden at once: a frame that shows nothing says nothing of its own translation.
    """
    few = visible.sum(axis=1) < 2
    return visible | few[:, None]


def fill(W: Array, X: Array, visible: Mask) -> Array:
    """Centred tracks: what is visible of W, and X, centred, where it is not.

    With t as in :func:`misfit` this is W - t 1' completed by X: the minimiser over the hidden entries of
    |W - X - t 1'|^2.
    """
    X = X - X.mean(axis=2, keepdims=True)
    return X + misfit(W, X, visible)


def complete(tracks: Array, visible: Mask | None, *, max_iter: int = 1000, tol: float = 1e-4) -> Array:
    """Complete tracks without cameras, by the least nuclear norm.

        min |X|_*  s.t.  X + t 1' = W where visible

    over the centred (2F, P) matrix X and the translations t, by ADMM: the step on X is a projection, see
    :func:`misfit`, the one on its split a singular value threshold. Tracks of moving bodies have low rank.

    Parameters
    ----------
    tracks : (F, 2, P) array
        NaN where they are not visible.
    visible : (F, P) bool array or None
        None returns the tracks as they are.
    max_iter : int
    tol : float
        Relative size of the primal and dual residuals to stop at.

    Returns
    -------
    (F, 2, P) array
        In the units and about the origin of the tracks; visible positions are kept.

    Raises
    ------
    MethodError
        As :func:`check_gaps`.

    References
    ----------
    Candes, Recht, "Exact matrix completion via convex optimization", 2009.
    """
    if visible is None:
        return tracks
    check_gaps(tracks, visible)
    F, _, P = tracks.shape
    W = np.where(visible[:, None], tracks, 0)
    Z = misfit(W, np.zeros_like(W), visible)
    size = max(float(np.linalg.norm(Z)), float(np.finfo(float).tiny))
    b = 20.0 / max(float(np.linalg.norm(Z.reshape(2 * F, P), 2)), float(np.finfo(float).tiny))
    Y = np.zeros_like(Z)  # scaled multiplier of the split
    X = Z
    for iteration in range(1, max_iter + 1):
        X = fill(W, Z + Y, visible)
        before = Z
        Z = singular_value_threshold((X - Y).reshape(2 * F, P), 1 / b)[0].reshape(F, 2, P)
        Y = Y + Z - X
        primal, dual = float(np.linalg.norm(Z - X)) / size, float(np.linalg.norm(Z - before)) / size
        if max(primal, dual) < tol:
            break
        if iteration % 10 == 0 and iteration < max_iter // 2:
            factor = 2.0 if primal > 5 * dual else 0.5 if dual > 5 * primal else 1.0
            b *= factor
            Y = Y / factor
    t = np.where(visible[:, None], W - X, 0).sum(axis=2, keepdims=True) / visible.sum(axis=1)[:, None, None]
    return np.where(visible[:, None], tracks, X + t)
