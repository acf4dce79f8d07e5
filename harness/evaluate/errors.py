"""Formulas of the errors, from arrays of an estimate and of the truth.

Points count whether they were observed or not, where their true place is known; places that are NaN do not count.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from nrsfm.harness.evaluate.alignment import centre_bodies, polar_factor
from nrsfm.harness.evaluate.matching import matched
from nrsfm.methods.base import Array, Labels


def e_3d(estimate: Array, truth: Array) -> float:
    """The paper's error, eq. (22): mean over frames of |S_est - S_gt|_F / |S_gt|_F, both (F, 3, P).

    Frames in which nothing is known do not count.
    """
    return float(np.nanmean(frame_errors(estimate, truth)))


def frame_errors(estimate: Array, truth: Array) -> Array:
    """|S_est - S_gt|_F / |S_gt|_F of each frame, (F,), both (F, 3, P); NaN where nothing is known."""
    size = norm(truth, (1, 2))
    error = norm(estimate - truth, (1, 2))
    return np.asarray(np.divide(error, size, out=np.full(len(size), np.nan), where=size > 0))


def e_3d_total(estimate: Array, truth: Array) -> float:
    """|S_est - S_gt|_F / |S_gt|_F over the whole sequence."""
    return float(norm(estimate - truth) / norm(truth))


def e_3d_procrustes(estimate: Array, truth: Array) -> float:
    """:func:`e_3d` after the best orthogonal matrix of each frame."""
    return e_3d(polar_factor(np.nan_to_num(truth) @ np.nan_to_num(estimate).transpose(0, 2, 1)) @ estimate, truth)


def e_3d_dai(estimate: Array, truth: Array) -> float:
    """Mean distance over frames and points, over the mean standard deviation of the truth's rows.

    The number of the older literature; Dai, Li, He, CVPR 2012, after Akhter et al. 2011.
    """
    return float(np.nanmean(np.linalg.norm(estimate - truth, axis=1)) / np.nanstd(truth, axis=2).mean())


def e_3d_centred(estimate: Array, truth: Array, labels: Labels) -> float:
    """:func:`e_3d` after each body (true labels) is centred per frame: shape alone, without placement."""
    return e_3d(centre_bodies(estimate, labels), centre_bodies(truth, labels))


def e_r(estimate: Array, truth: Array) -> float:
    """Mean over frames of the spectral norm of R_est - R_gt, (F, 2, 3), after one orthogonal matrix."""
    turned = estimate @ polar_factor(np.einsum("fij,fik->jk", estimate, truth))
    return float(np.linalg.norm(turned - truth, ord=2, axis=(1, 2)).mean())


def n_wrong(estimate: Labels, truth: Labels) -> int:
    """Number of tracks that are wrongly labelled under the best one-to-one matching of clusters to bodies.

    Where there are more clusters than bodies, or fewer, all tracks of those without a match are wrong.
    """
    return int((matched(estimate, truth) != truth).sum())


def affinity_between(affinity: Array | sp.sparray, truth: Labels) -> float:
    """Share of the affinity that joins tracks of different bodies; 0 for a block-diagonal affinity."""
    if sp.issparse(affinity):
        pairs = sp.coo_array(affinity)
        joins = pairs.row != pairs.col
        total = pairs.data[joins].sum(dtype=float)
        between = pairs.data[truth[pairs.row] != truth[pairs.col]].sum(dtype=float)
    else:
        total = affinity.sum() - np.trace(affinity)
        between = affinity[truth[:, None] != truth[None, :]].sum()
    return float(between / total) if total > 0 else 1.0


def norm(X: Array, axis: tuple[int, ...] | None = None) -> Array:
    """Frobenius norm of the entries that are not NaN."""
    return np.asarray(np.sqrt(np.nansum(X**2, axis=axis)))
