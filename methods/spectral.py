"""Normalised spectral clustering of an affinity."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from sklearn.cluster import KMeans

from methods.base import Array, Labels, MethodError

#: Clusters at most, where their number is estimated.
MOST = 10


def spectral_clustering(affinity: Array, n_clusters: int | None, *, restarts: int = 20, seed: int = 0) -> Labels:
    """Cut a graph into clusters by the leading eigenvectors of its normalised affinity.

    Parameters
    ----------
    affinity : (P, P) array
        Symmetric, non-negative; the diagonal is ignored.
    n_clusters : int or None
        None takes what :func:`count_clusters` estimates.
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
    if n_clusters is not None and affinity.shape[0] < n_clusters:
        raise MethodError(f"cannot cut {affinity.shape[0]} tracks into {n_clusters} clusters")
    if not np.isfinite(affinity).all():
        raise MethodError("the affinity holds NaN or infinite values: the code it comes from diverged")
    if n_clusters is None:
        n_clusters = count_clusters(affinity)[0]
    rows = embedding(affinity, n_clusters)
    return KMeans(n_clusters, n_init=restarts, random_state=seed).fit_predict(rows).astype(np.int64)


def count_clusters(affinity: Array, most: int = MOST) -> tuple[int, float]:
    """The number of clusters by the eigengap of the normalised Laplacian.

    With 0 = v_1 <= v_2 <= ... the eigenvalues of I - D^-1/2 A D^-1/2, n clusters that nothing joins make v_n = 0 and
    v_(n+1) > 0; the estimate is the n of the widest gap v_(n+1) - v_n.

    Parameters
    ----------
    affinity : (P, P) array
        Symmetric, non-negative; the diagonal is ignored.
    most : int
        Of 1..most, and less than P, the estimate is taken.

    Returns
    -------
    int, float
        The number and its gap, between 0 and 2.

    References
    ----------
    von Luxburg, "A tutorial on spectral clustering", Statistics and Computing 2007, section 8.3; Kumar, Dai, Li, 3DV
    2016, section 4, note on the number of clusters.
    """
    gaps = eigengaps(affinity, most)
    n = int(np.argmax(gaps)) + 1
    return n, float(gaps[n - 1])


def eigengaps(affinity: Array, most: int = MOST) -> Array:
    """v_(n+1) - v_n of the normalised Laplacian for n = 1..most, fewer where there are no more points."""
    P = len(affinity)
    first = max(0, P - most - 1)
    values = scipy.linalg.eigh(
        normalised(affinity), eigvals_only=True, subset_by_index=[first, P - 1], check_finite=False
    )
    return values[::-1][:-1] - values[::-1][1:]


def embedding(affinity: Array, n_vectors: int) -> Array:
    """Rows of the ``n_vectors`` leading eigenvectors of D^-1/2 A D^-1/2, each scaled to unit length."""
    n = len(affinity)
    _, U = scipy.linalg.eigh(normalised(affinity), subset_by_index=[n - n_vectors, n - 1], check_finite=False)
    return U / np.maximum(np.linalg.norm(U, axis=1, keepdims=True), np.finfo(float).tiny)


def normalised(affinity: Array) -> Array:
    """D^-1/2 A D^-1/2, the diagonal of A zero and D its row sums."""
    A = affinity - np.diag(np.diag(affinity))
    root = 1 / np.sqrt(np.maximum(A.sum(axis=1), np.finfo(float).tiny ** 0.5))
    return root[:, None] * A * root
