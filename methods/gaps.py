"""Tracks with gaps: residuals over the visible positions, and completion for methods that need whole tracks.

An orthographic image fixes structure up to a translation t_f of each frame. Without gaps t_f is the centroid. With gaps
it is unknown, so residuals are taken after the translation that fits the visible points best.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nrsfm.methods.base import Array, Mask, Observations, check_tracks, standardise
from nrsfm.methods.numerics.admm import Admm
from nrsfm.methods.numerics.linear import TINY
from nrsfm.methods.numerics.proximal import singular_value_threshold


def misfit(W: Array, X: Array, visible: Mask | None) -> Array:
    """W - X - t 1' where visible and 0 elsewhere, t (F, 2) the best translation; W - X for visible = None.

    t_f is the mean of W - X over the visible points of frame f.
    """
    if visible is None:
        return W - X
    return np.where(visible[:, None], W - X - translation(W, X, visible), 0)


def translation(W: Array, X: Array, visible: Mask) -> Array:
    """t (F, 2, 1), the mean of W - X over the visible points of each frame."""
    D = np.where(visible[:, None], W - X, 0)
    t: Array = D.sum(axis=2, keepdims=True) / visible.sum(axis=1)[:, None, None]
    return t


def enough(visible: Mask) -> Mask:
    """The mask with all points marked visible in frames that show fewer than two.

    For a cluster of tracks that are hidden at once: a frame that shows nothing does not determine its translation, so
    completed positions are used there.
    """
    mask: Mask = visible | (visible.sum(axis=1) < 2)[:, None]
    return mask


def fill(W: Array, X: Array, visible: Mask) -> Array:
    """Centred tracks: W where it is visible, and the centred X where it is not.

    With t as in :func:`misfit` this is W - t 1' completed by X: the minimiser over the hidden entries of
    |W - X - t 1'|^2.
    """
    X = X - X.mean(axis=2, keepdims=True)
    return X + misfit(W, X, visible)


def complete_by(observations: Observations, fit: Callable[[Array, Array, Mask], Array]) -> Array:
    """Centred tracks whose gaps are filled with the images of a structure; tracks without gaps as they are.

    ``fit`` gives the structure (F, 3, P) of standardised tracks (F, 2, P), cameras (F, 2, 3) and visible (F, P).
    """
    visible, cameras = observations.visible, observations.required_cameras()
    if visible is None:
        return observations.tracks
    data = standardise(observations.tracks, visible)
    observations.stage("gaps")
    return data.scale * fill(data.W, cameras @ fit(data.W, cameras, visible), visible)


def complete(tracks: Array, visible: Mask | None, *, max_iter: int = 1000, tol: float = 1e-4) -> Array:
    """Complete tracks without cameras, by the least nuclear norm of the result.

        min |X|_*  s.t.  X + t 1' = W where visible

    over the centred (2F, P) matrix X and the translations t, by ADMM: the step on X is a projection, see
    :func:`misfit`, the one on its split a singular value threshold. Tracks of moving bodies have low rank.

    The (F, 2, P) result has the units and the origin of the tracks, and keeps their visible positions. Without an
    (F, P) mask of what is visible it is the tracks as they are. The iteration stops when the relative primal and dual
    residuals are below ``tol``. Raises MethodError as :func:`nrsfm.methods.base.check_tracks`.

    References
    ----------
    Candes, Recht, "Exact matrix completion via convex optimization", 2009.
    """
    if visible is None:
        return tracks
    check_tracks(tracks, visible)
    F, _, P = tracks.shape
    W = np.where(visible[:, None], tracks, 0)
    X = Z = misfit(W, np.zeros_like(W), visible)
    size = max(float(np.linalg.norm(Z)), TINY)
    Y = np.zeros_like(Z)  # scaled multiplier of the split
    admm = Admm(max_iter, tol, 20.0 / max(float(np.linalg.norm(Z.reshape(2 * F, P), 2)), TINY))
    for b in admm:
        X = fill(W, Z + Y, visible)
        before = Z
        Z = singular_value_threshold((X - Y).reshape(2 * F, P), 1 / b)[0].reshape(F, 2, P)
        Y = Y + Z - X
        Y /= admm.balance(float(np.linalg.norm(Z - X)) / size, float(np.linalg.norm(Z - before)) / size)
    return np.where(visible[:, None], tracks, X + translation(W, X, visible))
