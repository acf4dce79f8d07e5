"""Proximal steps shared by the solvers."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from nrsfm.methods.base import Array
from nrsfm.methods.numerics.linear import symmetric_eigen


def soft(X: Array, threshold: float) -> Array:
    """Soft threshold, the proximal step of ``threshold * |X|_1``: sign(x) max(|x| - threshold, 0).

    Boyd, Parikh, Chu, Peleato, Eckstein, "Distributed optimization and statistical learning via the alternating
    direction method of multipliers", 2011, section 4.4.3.
    """
    return X - np.clip(X, -threshold, threshold)


def singular_value_threshold(M: Array, threshold: float) -> tuple[Array, float]:
    """Proximal step of ``threshold * |M|_*``: M with its singular values shrunk, and the nuclear norm of that.

    Works on the Gram matrix of the short side, O(F^2 N) for an (F, N) matrix with F <= N. Squaring loses singular
    values under about 1e-8 of the largest; they matter only when the threshold is as small, and then a
    full decomposition is taken.

    References
    ----------
    Cai, Candes, Shen, "A singular value thresholding algorithm for matrix completion", SIAM J. Optim. 2010,
    theorem 2.1.
    """
    if M.shape[0] > M.shape[1]:
        shrunk, norm = singular_value_threshold(M.T, threshold)
        return shrunk.T, norm
    w, U = symmetric_eigen(M @ M.T)
    s = np.sqrt(np.maximum(w, 0))
    if threshold < 1e-6 * s[-1]:
        U, s, Vt = scipy.linalg.svd(M, full_matrices=False, check_finite=False)
        kept = np.maximum(s - threshold, 0)
        return (U * kept) @ Vt, float(kept.sum())
    start = int((s <= threshold).sum())  # ascending
    U, s = U[:, start:], s[start:]
    return (U * (1 - threshold / s)) @ (U.T @ M), float((s - threshold).sum())


def weighted_singular_value_threshold(M: Array, thresholds: Array) -> Array:
    """Proximal step of ``sum_i thresholds_i sigma_i(M)`` with thresholds that do not fall.

    ``thresholds`` is (min(M.shape),), for singular values from the largest down. The sum is not convex, but with
    thresholds in this order shrinking each value by its own keeps the order of the values, and that is the minimiser.

    References
    ----------
    Gu, Zhang, Zuo, Feng, "Weighted nuclear norm minimization with application to image denoising", CVPR 2014; Oh, Tai,
    Bazin, Kim, Kweon, "Partial sum minimization of singular values in robust PCA", PAMI 2016, for thresholds of 0.
    """
    U, s, Vt = scipy.linalg.svd(M, full_matrices=False, check_finite=False)
    kept = s > thresholds
    shrunk: Array = (U[:, kept] * (s - thresholds)[kept]) @ Vt[kept]
    return shrunk
