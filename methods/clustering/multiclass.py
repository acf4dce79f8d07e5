"""Multiclass spectral clustering: the eigenvectors of the normalised cut, made labels by a rotation.

Yu and Shi, "Multiclass spectral clustering", ICCV 2003. Equation numbers below are theirs.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from nrsfm.methods.base import Array, Labels
from nrsfm.methods.numerics.linear import TINY, unit_rows

#: Attraction and repulsion that each point gets of itself, which keeps weakly joined points from being cut off alone.
REGULARISATION = 0.5
MOST_STEPS = 100


def rotation_cut(affinity: Array, n_clusters: int) -> Labels:
    """Cut a graph into clusters by the eigenvectors of its regularised normalised cut.

    With A + d I in place of A, and the degree of a point raised by 2 d (Yu and Shi, "Understanding popout through
    repulsion", CVPR 2001, with the repulsion d I), Z = D^-1/2 V has the leading eigenvectors V of
    D^-1/2 (A + d I) D^-1/2, eq. (13); its rows at unit length are what :func:`discretise` labels.

    Parameters
    ----------
    affinity : (P, P) array
        Symmetric, non-negative; the diagonal counts.
    n_clusters : int

    Returns
    -------
    (P,) int array
        Labels 0..n_clusters-1.
    """
    n = len(affinity)
    root = 1 / np.sqrt(affinity.sum(axis=1) + 2 * REGULARISATION)
    normalised = root[:, None] * (affinity + REGULARISATION * np.eye(n)) * root
    _, V = scipy.linalg.eigh(normalised, subset_by_index=[n - n_clusters, n - 1], check_finite=False)
    Z = root[:, None] * V
    return discretise(unit_rows(Z / np.maximum(np.linalg.norm(Z, axis=0), TINY)))


def discretise(X: Array) -> Labels:
    """The (P,) labels nearest to a rotation of (P, K) unit rows: min |L - X R| over indicators L and R'R = I.

    In turn the L and the R that minimise, eqs. (16) and (17), until the fit improves no more. R starts from rows of X:
    the middle one, then each time the one that is most nearly orthogonal to those before (section 4, step 4; the paper
    draws the first one at random).
    """
    n, K = X.shape
    R = np.zeros((K, K))
    R[:, 0] = X[(n - 1) // 2]
    along = np.zeros(n)
    for k in range(1, K):
        along += np.abs(X @ R[:, k - 1])
        R[:, k] = X[np.argmin(along)]
    fit = 0.0
    for _ in range(MOST_STEPS):
        labels: Labels = np.argmax(X @ R, axis=1).astype(np.int64)
        U, s, Vt = np.linalg.svd(np.eye(K)[labels].T @ X)
        R = Vt.T @ U.T
        before, fit = fit, float(s.sum())
        if fit - before < 1e-12 * n:
            break
    return labels
