"""SSC, EDSC and spectral clustering: exact subspaces, optimality, scikit-learn's contract."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp
from sklearn.base import BaseEstimator
from sklearn.utils.estimator_checks import parametrize_with_checks

from nrsfm.harness.evaluate.errors import n_wrong
from nrsfm.methods.base import MethodError
from nrsfm.methods.clustering.cuts import normalised_cut, recursive_cut
from nrsfm.methods.clustering.edsc import EDSC, dense_code
from nrsfm.methods.clustering.lrr import LRR
from nrsfm.methods.clustering.spectral import leading, spectral_clustering
from nrsfm.methods.clustering.ssc import DIAGONALS, SSC, code_affinity, sparse_code
from nrsfm.methods.clustering.ssc_omp import SSCOMP

#: Three blobs of the plane are no three subspaces: two of its points express all others.
BLOBS = {"check_clustering": "clusters blobs of the plane, which are one subspace"}


@parametrize_with_checks(  # type: ignore[untyped-decorator]
    [SSC(), SSCOMP(), EDSC(), LRR(), LRR(weight=None)],
    expected_failed_checks=lambda estimator: BLOBS if isinstance(estimator, SSCOMP) else {},
)
def test_scikit_learn_contract(estimator: BaseEstimator, check: Callable[[BaseEstimator], None]) -> None:
    check(estimator)


def union(n: int, dimension: int, ambient: int, each: int, affine: bool) -> tuple[np.ndarray, np.ndarray]:
    """Points on n random (affine) subspaces, in random order."""
    rng = np.random.default_rng(3)
    parts = []
    for _ in range(n):
        basis = np.linalg.qr(rng.standard_normal((ambient, dimension)))[0]
        parts.append(
            (basis @ rng.standard_normal((dimension, each))).T + (rng.standard_normal(ambient) if affine else 0)
        )
    order = rng.permutation(n * each)
    return np.concatenate(parts)[order], np.repeat(np.arange(n), each)[order]


@pytest.mark.parametrize("affine", [False, True])
@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.parametrize("kind", ["ssc", "ssc share .7", "edsc"])
def test_recovers_exact_subspaces(kind: str, n: int, affine: bool) -> None:
    X, labels = union(n, 3, 30, 25, affine)
    model = EDSC(n, affine=affine) if kind == "edsc" else SSC(n, affine=affine, share=0.7 if "share" in kind else 1.0)
    assert n_wrong(model.fit(X).labels_, labels) == 0


def test_sparse_code_is_optimal() -> None:
    """No feasible direction lowers |C|_1 + a/2 |X - X C|^2 at the solution (affine, zero diagonal)."""
    X = union(2, 3, 20, 12, affine=True)[0].T
    C, _ = sparse_code(X, 50.0, True, 20000, 1e-10)
    assert np.abs(np.diag(C)).max() == 0
    np.testing.assert_allclose(C.sum(axis=0), 1, atol=1e-6)
    G = X.T @ X
    a = 50.0 / np.abs(G - np.diag(np.diag(G))).max(axis=0).min()

    def value(C: np.ndarray) -> float:
        return float(np.abs(C).sum() + a / 2 * np.sum((X - X @ C) ** 2))

    rng = np.random.default_rng(0)
    for _ in range(100):
        change = rng.standard_normal(C.shape) * 10.0 ** rng.uniform(-4, -1)
        np.fill_diagonal(change, 0)
        change -= (change.sum(axis=0) / (len(C) - 1)) * (1 - np.eye(len(C)))
        assert value(C + change) >= value(C) - 1e-6


def plain_sparse_code(
    X: np.ndarray, alpha: float, affine: bool, max_iter: int, tol: float, diagonal: str
) -> tuple[np.ndarray, int]:
    """The same iteration as its algorithm is printed: one (N, N) inverse, and the multipliers as they are."""
    n = X.shape[1]
    G = X.T @ X
    a = alpha / np.abs(G - np.diag(np.diag(G))).max(axis=0).min()
    one = np.ones((n, 1))
    inverse = np.linalg.inv(a * G + alpha * np.eye(n) + alpha * affine * one @ one.T)
    C, D, d = np.zeros((n, n)), np.zeros((n, n)), np.zeros((1, n))
    for k in range(1, max_iter + 1):
        Z = inverse @ (a * G + alpha * C - D + affine * one @ (alpha * one.T - d))
        if diagonal == "zeroed":
            Z -= np.diag(np.diag(Z))
        C = np.sign(Z + D / alpha) * np.maximum(np.abs(Z + D / alpha) - 1 / alpha, 0)
        np.fill_diagonal(C, 0)
        D += alpha * (Z - C)
        d += alpha * (one.T @ Z - 1)
        if max(np.abs(Z - C).max(), affine * np.abs(one.T @ Z - 1).max()) < tol:
            return C, k
    return C, max_iter


@pytest.mark.parametrize("diagonal", DIAGONALS)
@pytest.mark.parametrize("affine", [False, True])
@pytest.mark.parametrize("ambient", [5, 60])
def test_sparse_code_follows_the_plain_iteration(ambient: int, affine: bool, diagonal: str) -> None:
    """With fewer dimensions than points, and with more."""
    X = union(2, 3, ambient, 12, affine)[0].T
    for settings in ((800.0, affine, 7, 0.0), (20.0, affine, 200, 2e-4)):
        mine, expected = (code(X, *settings, diagonal) for code in (sparse_code, plain_sparse_code))
        assert mine[1] == expected[1]
        np.testing.assert_allclose(mine[0], expected[0], atol=1e-9)


@pytest.mark.parametrize("affine", [False, True])
def test_dense_code_is_optimal(affine: bool) -> None:
    """The gradient of 1/2 |C|^2 + weight/2 |X - X C|^2 vanishes, along 1'C = const when affine."""
    X = union(2, 3, 20, 12, affine)[0].T
    C = dense_code(X, 120.0, affine)
    gradient = C - 120.0 * X.T @ (X - X @ C)
    if affine:
        np.testing.assert_allclose(C.sum(axis=0), 1, atol=1e-9)
        gradient -= gradient.mean(axis=0)
    assert np.abs(gradient).max() < 1e-6


def test_share_keeps_the_largest_coefficients() -> None:
    C = np.array([[0.0, 0.5, 0.1], [0.6, 0.0, 0.3], [0.4, 0.5, 0.0]])
    kept = code_affinity(C, share=0.7, scale=False)
    np.testing.assert_allclose(
        kept, np.array([[0, 1.1, 0.5], [1.1, 0, 0.8], [0.5, 0.8, 0]]) - [[0, 0, 0.1], [0, 0, 0], [0.1, 0, 0]]
    )
    np.testing.assert_allclose(code_affinity(C, share=0.5, scale=False)[0, 2], 0)
    np.testing.assert_allclose(code_affinity(C), (C / C.max(axis=0)) + (C / C.max(axis=0)).T)


def test_spectral_clustering_cuts_blocks_and_is_deterministic() -> None:
    A = np.kron(np.eye(3), np.ones((7, 7))) + 0.01
    labels = spectral_clustering(A, 3)
    assert n_wrong(labels, np.repeat([0, 1, 2], 7)) == 0
    assert (labels == spectral_clustering(A, 3)).all()


def test_spectral_clustering_survives_isolated_tracks() -> None:
    A = np.kron(np.eye(2), np.ones((6, 6)))
    A = np.pad(A, (0, 1))
    labels = spectral_clustering(A, 2)
    assert n_wrong(labels[:-1], np.repeat([0, 1], 6)) == 0


def test_spectral_clustering_refuses_nonsense() -> None:
    with pytest.raises(MethodError, match="clusters"):
        spectral_clustering(np.ones((2, 2)), 3)
    with pytest.raises(MethodError, match="diverged"):
        spectral_clustering(np.full((4, 4), np.nan), 2)


def blocks(rng: np.random.Generator, apart: bool) -> np.ndarray:
    """The affinity of three groups of 30, joined weakly or not at all."""
    labels = np.repeat([0, 1, 2], 30)
    A = rng.random((90, 90)) * (rng.random((90, 90)) < 0.3) * (labels[:, None] == labels)
    if not apart:
        A += 0.02 * (rng.random((90, 90)) < 0.05)
    symmetric: np.ndarray = A + A.T
    return symmetric


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("n", [2, 3])
def test_sparse_affinity_is_cut_as_a_dense_one(rng: np.random.Generator, apart: bool, n: int) -> None:
    A = blocks(rng, apart)
    sparse = spectral_clustering(sp.csr_array(A), n)
    if not (apart and n == 2):  # which two of three components stay together is anyone's choice
        assert n_wrong(sparse, spectral_clustering(A, n)) == 0
    np.testing.assert_array_equal(sparse, spectral_clustering(sp.csc_array(A), n))
    if n == 3:
        assert n_wrong(sparse, np.repeat([0, 1, 2], 30)) == 0


def test_sparse_eigenvectors_are_the_leading_ones(rng: np.random.Generator) -> None:
    """Two components and four vectors: the multiple eigenvalue 1, and the next two below it."""
    A = np.zeros((60, 60))
    for part in (slice(0, 25), slice(25, 60)):
        block = rng.random((60, 60))[part, part]
        A[part, part] = block + block.T
    np.fill_diagonal(A, 0)
    root = 1 / np.sqrt(A.sum(axis=1))
    normalised = root[:, None] * A * root
    values, U = leading(sp.csr_array(A), 4)
    np.testing.assert_allclose(U.T @ U, np.eye(4), atol=1e-10)
    top = np.linalg.eigvalsh(normalised)[-4:]
    np.testing.assert_allclose(values, top, atol=1e-10)
    np.testing.assert_allclose(np.linalg.eigvalsh(U.T @ normalised @ U), top, atol=1e-10)
    assert np.abs(normalised @ U - U @ (U.T @ normalised @ U)).max() < 1e-8


def _chain(n: int, weak: tuple[int, ...]) -> sp.csr_array:
    """A path of n points whose edges have weight 1, and .01 behind the ``weak`` ones."""
    weights = np.where(np.isin(np.arange(n - 1), weak), 0.01, 1.0)
    return sp.csr_array(sp.diags_array([weights, weights], offsets=[-1, 1]))


def test_normalised_cut_is_what_leaves_each_cluster_over_its_volume(rng: np.random.Generator) -> None:
    A = rng.uniform(size=(12, 12))
    A = np.triu(A, 1) + np.triu(A, 1).T
    labels = np.arange(12) % 3
    plain = sum(A[labels == k][:, labels != k].sum() / A[labels == k].sum() for k in range(3))
    assert normalised_cut(sp.csr_array(A), labels, 3) == pytest.approx(plain)
    assert normalised_cut(sp.csr_array(A), labels, 4) == pytest.approx(plain + 1)  # no cluster is never cheap


@pytest.mark.parametrize("weak", [(30,), (9, 30), (9, 20, 30)])
def test_recursive_cut_takes_the_weak_links_of_a_path(weak: tuple[int, ...]) -> None:
    def second(part: sp.csr_array) -> np.ndarray:
        return leading(part, 2)[1][:, 0]

    A = _chain(60, weak)
    labels = recursive_cut(A, len(weak) + 1, second(A), second)
    assert tuple(np.flatnonzero(np.diff(labels))) == weak


def test_a_split_is_the_cheapest_prefix(rng: np.random.Generator) -> None:
    A = sp.random_array((40, 40), density=0.2, rng=rng)
    A = sp.csr_array(A + A.T)
    A.setdiag(0)
    second = rng.standard_normal(40)
    order = np.argsort(second / np.sqrt(np.maximum(A.sum(axis=1), 1e-150)), kind="stable")
    labels = recursive_cut(A, 2, second, lambda _: second)
    prefixes = [np.isin(np.arange(40), order[:k]).astype(np.int64) for k in range(1, 40)]
    assert normalised_cut(A, labels, 2) == pytest.approx(min(normalised_cut(A, p, 2) for p in prefixes))


@pytest.mark.parametrize("dense", [False, True])
def test_the_cheaper_of_both_cuts(dense: bool) -> None:
    """A long tail in one cluster draws the means over the weak link; the cheaper cut is at the link."""
    A = _chain(400, (60,))
    labels = spectral_clustering(A.toarray() if dense else A, 2, cut="cheapest")
    assert normalised_cut(A, labels, 2) < 0.5 * normalised_cut(A, spectral_clustering(A, 2), 2)
    assert normalised_cut(A, labels, 2) <= normalised_cut(A, (np.arange(400) > 60).astype(np.int64), 2) + 1e-12


@pytest.mark.parametrize("n", [2, 3, 5])
def test_tracks_that_nothing_joins_are_no_cheap_cluster(n: int) -> None:
    """All of a path but six isolated tracks, and a graph without an edge: that number of labels, or no crash."""
    A = sp.csr_array(sp.block_diag([_chain(40, (12, 25)), sp.csr_array((6, 6))]))
    labels = spectral_clustering(A, n, cut="cheapest")
    assert len(set(labels[:40].tolist())) == n
    assert spectral_clustering(sp.csr_array((8, 8)), n, cut="cheapest").shape == (8,)
