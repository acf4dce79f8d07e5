"""Normalised spectral clustering of an affinity."""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, eigsh
from sklearn.cluster import KMeans

from methods.base import Array, Labels, MethodError

TINY = float(np.finfo(float).tiny)


def spectral_clustering(affinity: Array | sp.sparray, n_clusters: int, *, restarts: int = 20, seed: int = 0) -> Labels:
    """Cut a graph into clusters by the leading eigenvectors of its normalised affinity.

    Parameters
    ----------
    affinity : (P, P) array or sparse array
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
    if not np.isfinite(affinity.data if sp.issparse(affinity) else affinity).all():
        raise MethodError("the affinity holds NaN or infinite values: the code it comes from diverged")
    rows = embedding(affinity, n_clusters)
    return KMeans(n_clusters, n_init=restarts, random_state=seed).fit_predict(rows).astype(np.int64)


def embedding(affinity: Array | sp.sparray, n_vectors: int) -> Array:
    """Rows of the ``n_vectors`` leading eigenvectors of D^-1/2 A D^-1/2, each scaled to unit length.

    Steps 2 to 4 of the algorithm of Ng, Jordan, Weiss, NIPS 2001; D holds the row sums of A, whose diagonal is zero.
    """
    if sp.issparse(affinity):
        U = _sparse_eigenvectors(sp.csr_array(affinity), n_vectors)
    else:
        A = affinity - np.diag(np.diag(affinity))
        n = len(A)
        root = 1 / np.sqrt(np.maximum(A.sum(axis=1), TINY**0.5))
        normalised = root[:, None] * A * root
        _, U = scipy.linalg.eigh(normalised, subset_by_index=[n - n_vectors, n - 1], check_finite=False)
    return U / np.maximum(np.linalg.norm(U, axis=1, keepdims=True), TINY)


def _sparse_eigenvectors(A: sp.csr_array, n_vectors: int) -> Array:
    """Leading eigenvectors of D^-1/2 A D^-1/2 by Lanczos from a fixed start; the same every time.

    Lanczos from one start cannot see that an eigenvalue is multiple, and 1 is so when the graph falls apart. Those
    eigenvectors are known, one a component, so they are taken (the heaviest first) and projected out.
    """
    A = A.astype(float)
    A.setdiag(0)
    n = A.shape[0]
    degree = np.asarray(A.sum(axis=1)).ravel()
    root = 1 / np.sqrt(np.maximum(degree, TINY**0.5))
    count, part = connected_components(A, directed=False)
    heaviest = np.argsort(-np.bincount(part, degree, count), kind="stable")[:n_vectors]
    known = np.sqrt(degree)[:, None] * (part[:, None] == heaviest)
    known /= np.maximum(np.linalg.norm(known, axis=0), TINY)
    if count >= n_vectors:
        return known
    normalised = sp.diags_array(root) @ A @ sp.diags_array(root)
    operator = LinearOperator((n, n), lambda x: normalised @ x - known @ (known.T @ x), dtype=float)
    wanted = n_vectors - count
    start = np.random.default_rng(0).standard_normal(n)
    _, U = eigsh(operator, wanted, which="LA", v0=start, ncv=min(n, max(40, 4 * wanted)), maxiter=100 * n)
    return np.concatenate([U, known], axis=1)
