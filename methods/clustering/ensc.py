"""Elastic net subspace clustering (You, Li, Robinson, Vidal, CVPR 2016)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from nrsfm.methods.base import Array, MethodError, check_positive
from nrsfm.methods.clustering.clusterer import SubspaceClusterer
from nrsfm.methods.numerics.linear import unit_rows


@dataclass(eq=False, repr=False)
class EnSC(SubspaceClusterer):
    """Cluster points on a union of subspaces by codes between sparse ones and dense ones.

    Parameters
    ----------
    n_clusters : int or None
        None takes the number at the widest eigengap of the affinity.
    gamma : float
        Weight of the residual, in parts of the weight at which a point's code vanishes; above 1.
    mixing : float
        Lambda: near 1 codes are sparse, near 0 dense; between 0 and 1.
    seed : int
        Of k-means.
    cut : {"means", "cheapest", "rotation"}
        See :func:`nrsfm.methods.clustering.spectral.spectral_clustering`.

    Attributes
    ----------
    code_ : (n_samples, n_samples) sparse array
        C, with X about X C for columns X of unit length, and a zero diagonal.
    affinity_matrix_ : (n_samples, n_samples) sparse array
        |C| + |C'| of columns at unit length.

    References
    ----------
    You, Li, Robinson, Vidal, "Oracle based active set algorithm for scalable elastic net subspace clustering", CVPR
    2016, eq. (3), theorem 2 and algorithm 1.
    """

    n_clusters: int | None = 2
    _: KW_ONLY
    gamma: float = 5000.0
    mixing: float = 0.9
    seed: int = 0
    cut: str = "means"

    def _check_settings(self) -> None:
        check_positive(self, "gamma", "mixing")
        if self.mixing >= 1:
            raise MethodError(f"EnSC: mixing is {self.mixing}; below 1 is wanted, and 1 is SSC")

    def _express(self, X: Array) -> sp.csc_array:
        points = unit_rows(X.T)
        G = points @ points.T
        codes = []
        for j in range(len(G)):
            others = np.arange(len(G)) != j
            largest = float(np.abs(G[others, j]).max())
            weight = self.gamma * self.mixing / largest if largest > 0 else 0.0
            c = np.zeros(len(G))
            c[others] = elastic_net(G[np.ix_(others, others)], G[others, j], weight, self.mixing)
            codes.append(c)
        return sp.csc_array(np.stack(codes, axis=1))

    def _affinity(self, n_clusters: int | None) -> sp.csr_array:
        A = sp.csr_array(np.abs(unit_rows(self.code_.T.toarray())))
        return sp.csr_array(A + A.T)


def elastic_net(G: Array, g: Array, weight: float, mixing: float, tol: float = 1e-9) -> Array:
    """min mixing |c|_1 + (1 - mixing)/2 |c|^2 + weight/2 |x - X c|^2, from G = X'X and g = X'x.

    With d = weight X'(x - X c) the solution has d_i = mixing sign(c_i) + (1 - mixing) c_i on its support and
    |d_i| <= mixing off it. The point that violates this most joins the support; then the smooth problem for the signs
    at hand is solved, where a coefficient that would change its sign stops at zero and leaves. Every step lowers the
    objective, and there are finitely many supports.
    """
    c = np.zeros(len(g))
    signs = np.zeros(len(g))
    while True:
        d = weight * (g - G @ c)
        outside = np.where(signs == 0, np.abs(d), 0)
        if (i := int(outside.argmax()), outside[i])[1] <= mixing * (1 + tol):
            return c
        signs[i] = np.sign(d[i])
        while True:
            on = np.flatnonzero(signs)
            A = weight * G[np.ix_(on, on)] + (1 - mixing) * np.eye(len(on))
            target = scipy.linalg.solve(A, weight * g[on] - mixing * signs[on], assume_a="pos", check_finite=False)
            crossed = target * signs[on] <= 0
            if not crossed.any():
                c[on] = target
                break
            share = np.where(crossed, c[on] / (c[on] - target), np.inf)
            first = int(share.argmin())
            c[on] += share[first] * (target - c[on])
            c[on[first]] = signs[on[first]] = 0
