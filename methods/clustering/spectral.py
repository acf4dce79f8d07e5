"""Normalised spectral clustering of an affinity."""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, eigsh

from nrsfm.methods.base import Array, Labels, MethodError
from nrsfm.methods.clustering.cuts import normalised_cut, recursive_cut
from nrsfm.methods.clustering.multiclass import rotation_cut
from nrsfm.methods.numerics.linear import TINY, unit_rows

#: Ways to make labels of eigenvectors, see :func:`spectral_clustering`.
CUTS = ("means", "cheapest", "rotation")
#: The most clusters, where their number is estimated.
MOST = 10


def spectral_clustering(
    affinity: Array | sp.sparray, n_clusters: int | None, *, seed: int = 0, cut: str = "means"
) -> Labels:
    """Cut a graph into clusters by the leading eigenvectors of its normalised affinity.

    By k-means on the rows of the eigenvectors (Ng, Jordan, Weiss), unless another cut is asked for.

    Parameters
    ----------
    affinity : (P, P) array or sparse array
        Symmetric, non-negative; the diagonal is ignored, but for ``rotation``.
    n_clusters : int or None
        None takes what :func:`count_clusters` estimates.
    seed : int
        Of k-means, of whose 20 starts the tightest is kept. The result is deterministic.
    cut : {"means", "cheapest", "rotation"}
        ``means``: k-means. ``cheapest``: k-means or :func:`nrsfm.methods.clustering.cuts.recursive_cut`, whichever has
        the smaller normalised cut; where a cluster has a long thin arm, splits along one eigenvector at a time can have
        it. ``rotation``: :func:`nrsfm.methods.clustering.multiclass.rotation_cut`.

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
    Ng, Jordan, Weiss, "On spectral clustering: analysis and an algorithm", NIPS 2001. Shi, Malik, "Normalized cuts and
    image segmentation", PAMI 2000. Yu, Shi, "Multiclass spectral clustering", ICCV 2003.
    """
    if n_clusters is not None and affinity.shape[0] < n_clusters:
        raise MethodError(f"cannot cut {affinity.shape[0]} tracks into {n_clusters} clusters")
    if not np.isfinite(affinity.data if sp.issparse(affinity) else affinity).all():
        raise MethodError("the affinity holds NaN or infinite values: the code it comes from diverged")
    if n_clusters is None:
        n_clusters = count_clusters(affinity)[0]
    if n_clusters == 1:
        return np.zeros(affinity.shape[0], dtype=np.int64)
    if cut == "rotation":
        return rotation_cut(sp.csr_array(affinity).toarray(), n_clusters)
    _, vectors = leading(affinity, n_clusters)
    rows = unit_rows(vectors)
    from sklearn.cluster import KMeans  # slow to import, and who only builds methods needs none

    labels: Labels = KMeans(n_clusters, n_init=20, random_state=seed).fit_predict(rows).astype(np.int64)
    if cut == "means":
        return labels
    A = _without_loops(affinity)
    split = recursive_cut(A, n_clusters, vectors[:, -2], lambda part: leading(part, 2)[1][:, 0])
    return min((labels, split), key=lambda candidate: normalised_cut(A, candidate, n_clusters))


def count_clusters(affinity: Array | sp.sparray) -> tuple[int, float]:
    """The number of clusters by the eigengap of the normalised Laplacian.

    With 0 = v_1 <= v_2 <= ... the eigenvalues of I - D^-1/2 A D^-1/2, n clusters that nothing joins make v_n = 0 and
    v_(n+1) > 0; the estimate is the n of the widest gap v_(n+1) - v_n, of 1..MOST and less than P. Returned with its
    gap, which is between 0 and 2. The affinity is (P, P), symmetric and non-negative; its diagonal is ignored.

    References
    ----------
    von Luxburg, "A tutorial on spectral clustering", Statistics and Computing 2007, section 8.3; Kumar, Dai, Li, 3DV
    2016, section 4, note on the number of clusters.
    """
    gaps = eigengaps(affinity)
    n = int(np.argmax(gaps)) + 1
    return n, float(gaps[n - 1])


def eigengaps(affinity: Array | sp.sparray, most: int = MOST) -> Array:
    """v_(n+1) - v_n of the normalised Laplacian for n = 1..most, fewer where there are no more points."""
    values, _ = leading(affinity, min(most + 1, affinity.shape[0]))
    gaps: Array = values[::-1][:-1] - values[::-1][1:]
    return gaps


def leading(affinity: Array | sp.sparray, n_vectors: int) -> tuple[Array, Array]:
    """The ``n_vectors`` largest eigenvalues of D^-1/2 A D^-1/2 in ascending order, and their eigenvectors."""
    if sp.issparse(affinity):
        return _sparse_leading(_without_loops(affinity), n_vectors)
    A = affinity - np.diag(np.diag(affinity))
    n = len(A)
    root = 1 / np.sqrt(np.maximum(A.sum(axis=1), TINY**0.5))
    normalised = root[:, None] * A * root
    values, U = scipy.linalg.eigh(normalised, subset_by_index=[n - n_vectors, n - 1], check_finite=False)
    return values, U


def _without_loops(affinity: sp.sparray) -> sp.csr_array:
    """The graph in double precision, its diagonal left out."""
    A = sp.csr_array(affinity, dtype=float, copy=True)
    A.setdiag(0)
    A.eliminate_zeros()
    return A


def _sparse_leading(A: sp.csr_array, n_vectors: int) -> tuple[Array, Array]:
    """:func:`leading` for a sparse graph, by Lanczos from a fixed start; deterministic.

    Lanczos from one start does not find all eigenvectors of a multiple eigenvalue, and 1 is multiple when the graph has
    several components. Those eigenvectors are known, one per component. They are taken, the heaviest first, and their
    eigenvalue is shifted below all others, to -2.
    """
    n = A.shape[0]
    if not A.nnz:  # every vector is an eigenvector and Lanczos fails
        return np.zeros(n_vectors), np.eye(n, n_vectors)
    degree = np.asarray(A.sum(axis=1)).ravel()
    root = 1 / np.sqrt(np.maximum(degree, TINY**0.5))
    count, part = connected_components(A, directed=False)
    weight = np.bincount(part, degree, count)
    heaviest = np.argsort(-weight, kind="stable")[: min(n_vectors, int((weight > 0).sum()))]
    known = np.sqrt(degree)[:, None] * (part[:, None] == heaviest)
    known /= np.linalg.norm(known, axis=0)
    wanted = n_vectors - len(heaviest)
    if wanted == 0:
        return np.ones(n_vectors), known[:, ::-1]
    normalised = sp.diags_array(root) @ A @ sp.diags_array(root)
    operator = LinearOperator((n, n), lambda x: normalised @ x - 3 * (known @ (known.T @ x)), dtype=float)
    start = np.random.default_rng(0).standard_normal(n)
    values, U = eigsh(operator, wanted, which="LA", v0=start, ncv=min(n, max(40, 4 * wanted)), maxiter=100 * n)
    order = np.argsort(values, kind="stable")
    return np.append(values[order], np.ones(len(heaviest))), np.concatenate([U[:, order], known[:, ::-1]], axis=1)
