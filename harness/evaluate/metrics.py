"""The metrics: 3D error, rotation error, missegmentation. Truth and estimate in, numbers out.

Points count whether they were observed or not, where their true place is known; places that are NaN do not count.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from nrsfm.datasets.body import centre, observed
from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import Reconstruction
from nrsfm.methods.clustering.spectral import MOST, eigengaps
from nrsfm.methods.numerics.cameras import axes

Array = NDArray[np.float64]


Labels = NDArray[np.int64]


def e_3d(estimate: Array, truth: Array) -> float:
    """The paper's error, eq. (22): mean over frames of |S_est - S_gt|_F / |S_gt|_F, both (F, 3, P).

    Frames in which nothing is known do not count.
    """
    return float(np.nanmean(frame_errors(estimate, truth)))


def frame_errors(estimate: Array, truth: Array) -> Array:
    """|S_est - S_gt|_F / |S_gt|_F of each frame, (F,), both (F, 3, P); NaN where nothing is known."""
    size = _norm(truth, (1, 2))
    return np.divide(_norm(estimate - truth, (1, 2)), size, out=np.full(len(size), np.nan), where=size > 0)


def e_3d_total(estimate: Array, truth: Array) -> float:
    """|S_est - S_gt|_F / |S_gt|_F over the whole sequence."""
    return float(_norm(estimate - truth) / _norm(truth))


def e_3d_centred(estimate: Array, truth: Array, labels: Labels) -> float:
    """:func:`e_3d` after each body (true labels) is centred per frame: shape alone, without placement."""
    return e_3d(centre_bodies(estimate, labels), centre_bodies(truth, labels))


def e_3d_procrustes(estimate: Array, truth: Array) -> float:
    """:func:`e_3d` after the best orthogonal matrix of each frame."""
    U, _, Vt = np.linalg.svd(np.nan_to_num(truth) @ np.nan_to_num(estimate).transpose(0, 2, 1))
    return e_3d((U @ Vt) @ estimate, truth)


def e_3d_dai(estimate: Array, truth: Array) -> float:
    """Mean distance over frames and points, over the mean per-row standard deviation of the truth.

    The number of the older literature; Dai, Li, He, CVPR 2012, after Akhter et al. 2011.
    """
    return float(np.nanmean(np.linalg.norm(estimate - truth, axis=1)) / np.nanstd(truth, axis=2).mean())


def e_r(estimate: Array, truth: Array) -> float:
    """Mean over frames of the spectral norm of R_est - R_gt, (F, 2, 3), after one orthogonal matrix."""
    U, _, Vt = np.linalg.svd(np.einsum("fij,fik->jk", estimate, truth))
    return float(np.linalg.norm(estimate @ (U @ Vt) - truth, ord=2, axis=(1, 2)).mean())


def n_wrong(estimate: Labels, truth: Labels) -> int:
    """Tracks that stay wrongly labelled under the best one-to-one matching of clusters to bodies.

    Where there are more clusters than bodies, or fewer, all tracks of those that stay unmatched are wrong.
    """
    _, est = np.unique(estimate, return_inverse=True)
    _, true = np.unique(truth, return_inverse=True)
    table = np.zeros((est.max() + 1, true.max() + 1), dtype=int)
    np.add.at(table, (est, true), 1)
    rows, cols = linear_sum_assignment(-table)
    return int(len(truth) - table[rows, cols].sum())


def affinity_between(affinity: Array | sp.sparray, truth: Labels) -> float:
    """Share of the affinity that joins tracks of different bodies; 0 for a block-diagonal affinity."""
    if sp.issparse(affinity):
        pairs = sp.coo_array(affinity)
        joins = pairs.row != pairs.col
        total = pairs.data[joins].sum(dtype=float)
        between = pairs.data[truth[pairs.row] != truth[pairs.col]].sum(dtype=float)
        return float(between / total) if total > 0 else 1.0
    apart = truth[:, None] != truth[None, :]
    total = affinity.sum() - np.trace(affinity)
    return float(affinity[apart].sum() / total) if total > 0 else 1.0


def align_procrustes(estimate: Array, truth: Array) -> Array:
    """One orthogonal matrix (reflection allowed) for the whole sequence, by least squares."""
    return procrustes(estimate, truth) @ estimate


def procrustes(estimate: Array, truth: Array) -> Array:
    """The orthogonal (3, 3) matrix, reflection allowed, that takes one (F, 3, P) structure nearest to another."""
    U, _, Vt = np.linalg.svd(np.einsum("fip,fjp->ij", np.nan_to_num(truth), np.nan_to_num(estimate)))
    return U @ Vt


def align_polar(estimate: Array, truth: Array) -> Array:
    """One orthogonal matrix: the polar factor of the linear fit (S_gt S_est')(S_est S_est')^-1.

    The rule of the block matrix method's released code; not the Procrustes solution.
    """
    S_gt, S_est = np.nan_to_num(truth), np.nan_to_num(estimate)
    cross = np.einsum("fip,fjp->ij", S_gt, S_est)
    own = np.einsum("fip,fjp->ij", S_est, S_est)
    U, _, Vt = np.linalg.svd(cross @ np.linalg.pinv(own))
    return (U @ Vt) @ estimate


def centre_bodies(structure: Array, labels: Labels) -> Array:
    """Subtract each body's centroid in each frame from an (F, 3, P) structure."""
    centred = structure.copy()
    for label in np.unique(labels):
        mine = labels == label
        centred[:, :, mine] = centre(structure[:, :, mine])
    return centred


def _norm(X: Array, axis: tuple[int, ...] | None = None) -> Array:
    """The Frobenius norm of what is known."""
    return np.sqrt(np.nansum(X**2, axis=axis))


def evaluate(scene: Scene, found: Reconstruction, *, known_cameras: bool) -> dict[str, float]:
    """All metrics that the truth of the scene and the parts of the reconstruction allow.

    With known cameras nothing is aligned. With estimated ones, structure is known up to one orthogonal matrix:
    the e_3d family is aligned by Procrustes, e_3d_dai by the polar rule of its released code.

    Parameters
    ----------
    scene : Scene
        With truth, or without: then its metrics are left out.
    found : Reconstruction
    known_cameras : bool

    Returns
    -------
    dict of str to float
        Names as above, ``e_3d_body_k`` for each body, ``e_3d_visible`` and ``e_3d_hidden`` (where tracks have gaps:
        e_3d over the points that were observed, and over those that were not), ``e_ms`` (a share), ``n_wrong`` (a
        count), ``reprojection`` (relative, from the visible tracks alone), finite values only.
    """
    values: dict[str, float] = {}
    if found.structure is not None:
        values |= _structure_metrics(scene, found, known_cameras)
        cameras = found.cameras
        if cameras is not None:
            W = centre(scene.tracks)
            values["reprojection"] = float(_norm(centre(W - cameras @ found.structure)) / _norm(W))
            if scene.cameras is not None and not known_cameras:
                values["e_r"] = e_r(cameras, scene.cameras)
    if scene.labels is not None:
        if found.labels is not None:
            wrong = n_wrong(found.labels, scene.labels)
            values["n_wrong"] = float(wrong)
            values["e_ms"] = wrong / len(scene.labels)
        if found.affinity is not None:
            values["affinity_between"] = affinity_between(found.affinity, scene.labels)
    return {name: value for name, value in values.items() if np.isfinite(value)}


def reprojection_rms(scene: Scene, found: Reconstruction) -> float:
    """Root mean square distance of the visible tracks from R S, in their units, each frame's translation removed."""
    if found.structure is None or found.cameras is None:
        return float("nan")
    off = centre(centre(scene.tracks) - found.cameras @ found.structure)
    return float(np.sqrt(np.nanmean(np.sum(off**2, axis=1))))


def by_frame(scene: Scene, found: Reconstruction, *, known_cameras: bool) -> dict[str, Array]:
    """``frame_e_3d`` (F,), whose mean is e_3d, and ``alignment`` (3, 3), the matrix that it is taken after.

    Empty where there is no truth or no structure; with known cameras nothing is aligned.
    """
    if scene.structure is None or found.structure is None:
        return {}
    truth = centre(scene.structure)
    S = centre(np.where(np.isnan(truth), np.nan, found.structure))
    alignment = np.eye(3) if known_cameras else procrustes(S, truth)
    return {"frame_e_3d": frame_errors(alignment @ S, truth), "alignment": alignment}


def count(scene: Scene, found: Reconstruction) -> dict[str, float]:
    """How many bodies a method found that was not told their number.

    Returns
    -------
    dict of str to float
        ``n_bodies_found``; ``eigengap``, that of the affinity behind so many clusters; ``miscounted``, 1 where the
        number is not the scene's and 0 where it is. Nothing where there are no labels.
    """
    if found.labels is None:
        return {}
    n = len(np.unique(found.labels))
    values = {"n_bodies_found": float(n)}
    if found.affinity is not None and n <= MOST:
        values["eigengap"] = float(eigengaps(found.affinity)[n - 1])
    if scene.n_bodies is not None:
        values["miscounted"] = float(n != scene.n_bodies)
    return values


def _structure_metrics(scene: Scene, found: Reconstruction, known: bool) -> dict[str, float]:
    if scene.structure is None or found.structure is None:
        return {}
    truth = centre(scene.structure)
    S = centre(np.where(np.isnan(truth), np.nan, found.structure))
    keep: Callable[[Array, Array], Array] = lambda estimate, _: estimate  # noqa: E731
    align, polar = (keep, keep) if known else (align_procrustes, align_polar)
    aligned = align(S, truth)
    values = {
        "e_3d": e_3d(aligned, truth),
        "e_3d_total": e_3d_total(aligned, truth),
        "e_3d_procrustes": e_3d_procrustes(S, truth),
        "e_3d_dai": e_3d_dai(polar(S, truth), truth),
    }
    if scene.visible is not None:
        for name, part in (("visible", scene.visible), ("hidden", ~scene.visible)):
            if (part & observed(truth)).any():
                values[f"e_3d_{name}"] = e_3d(aligned, np.where(part[:, None], truth, np.nan))
    if found.cameras is not None and scene.cameras is not None:
        mine, true = axes(found.cameras) @ S, axes(scene.cameras) @ truth
        values["e_3d_dai_cam"] = e_3d_dai(polar(mine, true), true)
    if scene.labels is not None:
        centred = align(centre_bodies(S, scene.labels), centre_bodies(truth, scene.labels))
        values["e_3d_centred"] = e_3d_centred(centred, truth, scene.labels)
        for k in np.unique(scene.labels):
            body, own = S[:, :, scene.labels == k], truth[:, :, scene.labels == k]
            body, own = centre(body), centre(own)
            values[f"e_3d_body_{k}"] = e_3d(align(body, own), own)
    return values
