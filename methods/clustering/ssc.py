"""Sparse subspace clustering (Elhamifar and Vidal, PAMI 2013)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np
import scipy.linalg

from nrsfm.methods.base import Array, MethodError, check_count, check_positive, check_word
from nrsfm.methods.clustering.clusterer import SubspaceClusterer
from nrsfm.methods.numerics.admm import Admm
from nrsfm.methods.numerics.linear import TINY

#: Ways to keep diag(C) = 0, see :class:`SSC`.
DIAGONALS = ("constrained", "zeroed")


@dataclass(eq=False, repr=False)
class SSC(SubspaceClusterer):
    """Cluster points that lie on a union of (affine) subspaces by their sparse self-expression.

    Parameters
    ----------
    n_clusters : int or None
        None takes the number at the widest eigengap of the affinity.
    alpha : float
        Weight of the data term, relative to the smallest weight at which the code is not zero; also the
        penalty of the ADMM. 800 for motion, 20 for images.
    affine : bool
        Demand that each column of the code sums to one.
    share : float in (0, 1]
        Part of each column's l1 mass that is kept before clustering, largest coefficients first: 0.7 for motion
        in the authors' experiments, 1 keeps all.
    tol : float
        Stop when max|Z - C| and max|1'Z - 1'| are below it.
    seed : int
        Of k-means.
    diagonal : {"constrained", "zeroed"}
        How diag(C) = 0 is kept. ``constrained``: by the soft threshold, which makes that step exact. ``zeroed``: Z is
        set to zero there after its step as well, as in the authors' program; the iteration then solves another problem.

    Attributes
    ----------
    n_iter_ : int

    References
    ----------
    Elhamifar, Vidal, "Sparse subspace clustering: algorithm, theory, and applications", PAMI 2013, eq. (15)
    and algorithm 2.
    """

    n_clusters: int | None = 2
    _: KW_ONLY
    alpha: float = 800.0
    affine: bool = True
    share: float = 1.0
    max_iter: int = 200
    tol: float = 2e-4
    seed: int = 0
    diagonal: str = "constrained"

    def _check_settings(self) -> None:
        check_positive(self, "alpha", "tol", "share")
        check_count(self, "max_iter")
        check_word(self, "diagonal", DIAGONALS)
        if self.share > 1:
            raise MethodError(f"SSC: share is {self.share}, wanted a number in (0, 1]")
        if not isinstance(self.affine, bool):
            raise MethodError(f"SSC: affine is {self.affine!r}, wanted true or false")

    def _express(self, X: Array) -> Array:
        code, self.n_iter_ = sparse_code(X, self.alpha, self.affine, self.max_iter, self.tol, self.diagonal)
        return code

    def _affinity(self, n_clusters: int | None) -> Array:
        return code_affinity(self.code_, self.share)


def sparse_code(
    X: Array, alpha: float, affine: bool, max_iter: int, tol: float, diagonal: str = "constrained"
) -> tuple[Array, int]:
    """min |C|_1 + a/2 |X - X C|^2, diag(C) = 0, and 1'C = 1' when affine: eq. (15), by algorithm 2 with penalty alpha.

    With a = alpha / m (m as in :class:`SSC`) the penalty cancels from the Z-step. Stacked as V = [X / sqrt(m); 1'] it
    is Z = N + V'(I + V V')^-1 (B - V N), N = C - U, where B is V with the multiplier of 1'Z = 1' taken off its last
    row: two products with a matrix of D + 1 rows in place of one with an (N, N) inverse. X is (D, N), one point a
    column. Returns the (N, N) code and the number of iterations.
    """
    n = X.shape[1]
    G = X.T @ X
    off = np.abs(G - np.diag(np.diag(G)))
    smallest = off.max(axis=0).min()
    if smallest == 0:  # some point is orthogonal to all others: nothing expresses it
        smallest = max(off.max(), TINY)
    V = X / np.sqrt(smallest)
    if len(V) > n:  # V'V is all that counts
        V = scipy.linalg.qr(V, mode="r", check_finite=False)[0][:n]
    if affine:
        V = np.vstack([V, np.ones(n)])
    A = scipy.linalg.solve(np.eye(len(V)) + V @ V.T, V, assume_a="pos", check_finite=False).T
    B = V.copy()
    C = np.zeros((n, n))
    U = np.zeros((n, n))  # scaled multiplier of Z = C
    admm = Admm(max_iter, tol)
    for _ in admm:
        N = C - U
        Z = N + A @ (B - V @ N)
        if diagonal == "zeroed":
            np.fill_diagonal(Z, 0)
        Y = Z + U
        before, U = U, np.clip(Y, -1 / alpha, 1 / alpha)  # U + Z - C, with C the soft threshold of Y ...
        np.fill_diagonal(U, np.diag(Y))  # ... and zero on the diagonal
        C = Y - U
        slack = Z.sum(axis=0) - 1 if affine else np.zeros(n)
        if affine:
            B[-1] -= slack
        admm.report(code=np.abs(U - before).max(), affine=np.abs(slack).max())
    return C, admm.iteration


def code_affinity(C: Array, share: float = 1.0, scale: bool = True) -> Array:
    """|C| + |C'| after keeping each column's largest coefficients up to a share of its l1 mass.

    With ``scale`` each column is divided by its largest coefficient first: steps 2 and 3 of algorithm 1.
    """
    A = np.abs(C)
    if share < 1:
        order = np.argsort(-A, axis=0, kind="stable")
        ranked = np.take_along_axis(A, order, axis=0)
        before = np.cumsum(ranked, axis=0) - ranked
        ranked[before >= share * ranked.sum(axis=0)] = 0
        A = np.zeros_like(A)
        np.put_along_axis(A, order, ranked, axis=0)
    if scale:
        A = A / np.maximum(A.max(axis=0), TINY)
    return A + A.T
