"""Cameras from tracks alone."""

from __future__ import annotations

import numpy as np

from methods.base import Array, MethodError, standardise


def estimate_cameras(tracks: Array) -> Array:
    """Orthographic cameras of the rigid part of the scene, by factorisation to rank 3 and metric upgrade.

    The centred tracks are cut to rank 3, W = M B. A symmetric matrix L = G G' is fitted to the metric
    constraints m1 L m1' = m2 L m2', m1 L m2' = 0 and a mean square row length of 1, and each pair of rows of M G is
    replaced by the nearest orthonormal pair. Cameras are known up to one orthogonal matrix for the sequence.

    Parameters
    ----------
    tracks : (F, 2, P) array
        At least three frames and four points.

    Returns
    -------
    (F, 2, 3) array

    Raises
    ------
    MethodError
        If the tracks are too few, or flat: of rank less than 3.

    References
    ----------
    Tomasi, Kanade, "Shape and motion from image streams under orthography", IJCV 1992.
    """
    W = standardise(tracks).W
    F, _, P = W.shape
    if F < 3 or P < 4:
        raise MethodError(f"cameras cannot be estimated from {F} frames and {P} tracks; at least 3 and 4 are needed")
    U, s, _ = np.linalg.svd(W.reshape(2 * F, P), full_matrices=False)
    if s[2] < 1e-9 * s[0]:
        raise MethodError(
            "cameras cannot be estimated: the tracks have rank less than 3 (a flat scene or a fixed camera)"
        )
    M = (U[:, :3] * s[:3] / np.sqrt(P)).reshape(F, 2, 3)
    m1, m2 = M[:, 0], M[:, 1]
    equations = np.concatenate([_quadratic(m1, m1) - _quadratic(m2, m2), _quadratic(m1, m2), _total(m1, m2)])
    wanted = np.zeros(len(equations))
    wanted[-1] = F
    xx, xy, xz, yy, yz, zz = np.linalg.lstsq(equations, wanted, rcond=None)[0]
    w, V = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    G = V * np.sqrt(np.maximum(w, 1e-6 * w[-1]))
    return orthonormal_rows(M @ G)


def orthonormal_rows(A: Array) -> Array:
    """Nearest pairs of orthonormal rows to (F, 2, 3) matrices, each frame's sign following the frame before.

    A pair and its negative explain the same motion of the rows; the one nearer to the frame before is kept.
    """
    U, _, Vt = np.linalg.svd(A, full_matrices=False)
    R = U @ Vt
    agreement = np.einsum("fij,fij->f", R[1:], R[:-1])
    R[1:] *= np.cumprod(np.where(agreement < 0, -1.0, 1.0))[:, None, None]
    return R


def _quadratic(a: Array, b: Array) -> Array:
    """Rows of coefficients of a L b' for symmetric L = (xx, xy, xz, yy, yz, zz)."""
    return np.stack(
        [
            a[:, 0] * b[:, 0],
            a[:, 0] * b[:, 1] + a[:, 1] * b[:, 0],
            a[:, 0] * b[:, 2] + a[:, 2] * b[:, 0],
            a[:, 1] * b[:, 1],
            a[:, 1] * b[:, 2] + a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 2],
        ],
        axis=1,
    )


def _total(m1: Array, m2: Array) -> Array:
    return 0.5 * (_quadratic(m1, m1) + _quadratic(m2, m2)).sum(axis=0, keepdims=True)
