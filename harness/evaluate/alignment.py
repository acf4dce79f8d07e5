"""Alignment of an estimated structure with the true one: one orthogonal matrix for a whole sequence."""

from __future__ import annotations

import numpy as np

from nrsfm.datasets.body import centre
from nrsfm.methods.base import Array, Labels


def align_procrustes(estimate: Array, truth: Array) -> Array:
    """An (F, 3, P) estimate after :func:`procrustes`."""
    return np.asarray(procrustes(estimate, truth) @ estimate)


def procrustes(estimate: Array, truth: Array) -> Array:
    """The orthogonal (3, 3) matrix, reflection allowed, that takes one (F, 3, P) structure nearest to another."""
    return polar_factor(np.einsum("fip,fjp->ij", np.nan_to_num(truth), np.nan_to_num(estimate)))


def align_polar(estimate: Array, truth: Array) -> Array:
    """An (F, 3, P) estimate after the polar factor of its linear fit (S_gt S_est')(S_est S_est')^-1.

    The rule of the block matrix method's released code; not the Procrustes solution.
    """
    S_gt, S_est = np.nan_to_num(truth), np.nan_to_num(estimate)
    cross = np.einsum("fip,fjp->ij", S_gt, S_est)
    gram = np.einsum("fip,fjp->ij", S_est, S_est)
    return np.asarray(polar_factor(cross @ np.linalg.pinv(gram)) @ estimate)


def polar_factor(matrix: Array) -> Array:
    """The orthogonal matrix nearest to a square one, or to each of a stack (..., N, N)."""
    U, _, Vt = np.linalg.svd(matrix)
    return np.asarray(U @ Vt)


def centre_bodies(structure: Array, labels: Labels) -> Array:
    """Subtract each body's centroid in each frame from an (F, 3, P) structure."""
    centred = structure.copy()
    for label in np.unique(labels):
        body = labels == label
        centred[:, :, body] = centre(structure[:, :, body])
    return centred
