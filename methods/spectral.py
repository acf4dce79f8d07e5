"""Normalised spectral clustering of an affinity."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from sklearn.cluster import KMeans

from methods.base import Array, Labels, MethodError


def spectral_clustering(affinity: Array, n_clusters: int, *, restarts: int = 20, seed: int = 0) -> Labels:
    """Cut a graph into clusters by the leading eigenvectors of its normalised affinity.

    Parameters
    ----------
    affinity : (P, P) array
        Symmetric, non-negative; the diagonal is ignored.
    n_clusters : int
    restarts : int
        Starts of k-means; the tightest is kept.
    seed : int
        Of k-means. The result is deterministic.

    Returns
    -------
    (P,) int array
        Labels 0..n_clusters-1.

    Raises
    ------
    MethodError
        If the affinity is not finite, or there are fewer points than clusters.

    References
    ----------
    Ng, Jordan, Weiss, "On spectral clustering: analysis and an algorithm", NIPS 2001.
    """
    if affinity.shape[0] < n_clusters:
        raise MethodError(f"cannot cut {affinity.shape[0]} tracks into {n_clusters} clusters")
    if not np.isfinite(affinity).all():
        raise MethodError("the affinity holds NaN or infinite values: the code it comes from diverged")
    rows = embedding(affinity, n_clusters)
    return KMeans(n_clusters, n_init=restarts, random_state=seed).fit_predict(rows).astype(np.int64)


def embedding(affinity: Array, n_vectors: int) -> Array:
    """Rows of the ``n_vectors`` leading eigenvectors of D^-1/2 A D^-1/2, each scaled to unit length.

    Steps 2 to 4 of the algorithm of Ng, Jordan, Weiss, NIPS 2001; D holds the row sums of A, whose diagonal is zero.
    """
    A = affinity - np.diag(np.diag(affinity))
    n = len(A)
    root = 1 / np.sqrt(np.maximum(A.sum(axis=1), np.finfo(float).tiny ** 0.5))
    normalised = root[:, None] * A * root
    _, U = scipy.linalg.eigh(normalised, subset_by_index=[n - n_vectors, n - 1], check_finite=False)
    return U / np.maximum(np.linalg.norm(U, axis=1, keepdims=True), np.finfo(float).tiny)
