"""Proximal steps shared by the solvers."""

from __future__ import annotations

from nrsfm.methods.base import Array
from nrsfm.methods.numerics.backend import namespace, symmetric_eigen, thin_svd


def soft(X: Array, threshold: float) -> Array:
    """Soft threshold, the proximal step of ``threshold * |X|_1``: sign(x) max(|x| - threshold, 0).

    Boyd, Parikh, Chu, Peleato, Eckstein, "Distributed optimization and statistical learning via the alternating
    direction method of multipliers", 2011, section 4.4.3.
    """
    return X - namespace(X).clip(X, -threshold, threshold)


def singular_value_threshold(M: Array, threshold: float) -> tuple[Array, float]:
    """Proximal step of ``threshold * |M|_*``: shrink the singular values.

    Works on the Gram matrix of the short side, O(F^2 N) for an (F, N) matrix with F <= N. Squaring loses singular
    values under about 1e-8 of the largest; they matter only when the threshold is as small, and then a
    full decomposition is taken.

    Parameters
    ----------
    M : (F, N) array
    threshold : float

    Returns
    -------
    (F, N) array, float
        The shrunk matrix and its nuclear norm.

    References
    ----------
    Cai, Candes, Shen, "A singular value thresholding algorithm for matrix completion", SIAM J. Optim. 2010,
    theorem 2.1.
    """
    if M.shape[0] > M.shape[1]:
        shrunk, norm = singular_value_threshold(M.T, threshold)
        return shrunk.T, norm
    xp = namespace(M)
    w, U = symmetric_eigen(M @ M.T)
    s = xp.sqrt(xp.clip(w, 0.0, None))
    if threshold < 1e-6 * float(s[-1]):
        U, s, Vt = thin_svd(M)
        kept = xp.clip(s - threshold, 0.0, None)
        return (U * kept) @ Vt, float(xp.sum(kept))
    start = int(xp.sum(xp.astype(s <= threshold, xp.int64)))  # ascending
    U, s = U[:, start:], s[start:]
    return (U * (1 - threshold / s)) @ (U.T @ M), float(xp.sum(s - threshold))
