"""The spatial term of dense tracks: neighbours are expressed alike.

    l1 |C [I, w N]|_1 = l1 (|C|_1 + w sum over neighbours i, j of |C_i - C_j|_1)

With D = [I, w N], N (P, edges) the incidence matrix of the neighbours' graph, the code's constraint C = E becomes
C D = E. Each edge occurs once here and twice in the paper's P x 4P matrix. Kumar, Dai, Li, 3DV 2016, eqs. (7) to (11).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from nrsfm.methods.base import Array, MethodError
from nrsfm.methods.multibody.lagrangian import PrintedProblem
from nrsfm.methods.multibody.problem import State
from nrsfm.methods.numerics.linear import conjugate_gradients
from nrsfm.methods.numerics.proximal import soft

MOST_STEPS = 500  # of conjugate gradients, in case that rounding keeps them above the tolerance


class Neighbours:
    """The matrix D = [I, w N] and solvers with G = D D' = I + w^2 L, L the graph's Laplacian.

    The edges are (E, 2) pairs of neighbours, of which loops and repeated pairs are dropped; the weight is w.

    Raises
    ------
    MethodError
        If there is no pair, or one has an index outside 0..n_points - 1.
    """

    def __init__(self, edges: NDArray[np.int64], n_points: int, weight: float, dtype: Any = np.float64) -> None:
        pairs = np.unique(np.sort(edges, axis=1), axis=0).reshape(-1, 2)
        pairs = pairs[pairs[:, 0] != pairs[:, 1]]
        if not len(pairs):
            raise MethodError("method.spatial is above 0 and the scene has no neighbours; set it to 0")
        if pairs.min() < 0 or pairs.max() >= n_points:
            raise MethodError(f"edges name tracks outside 0..{n_points - 1}")
        self.pairs, self.weight, e = pairs, dtype(weight), len(pairs)
        ends = (pairs.T.ravel(), np.tile(np.arange(e), 2))
        N = sp.csr_array((np.repeat([1.0, -1.0], e), ends), shape=(n_points, e))
        self.D = sp.hstack([sp.eye_array(n_points), weight * N], format="csr", dtype=dtype)
        self.G = (self.D @ self.D.T).tocsr()
        self._factor = splu(self.G.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})

    def differences(self, C: Array) -> Array:
        """C D for (m, P) rows: the rows and their weighted differences along the edges, (m, P + E)."""
        i, j = self.pairs.T
        return np.concatenate([C, self.weight * (C[:, i] - C[:, j])], axis=1)

    def gather(self, E: Array) -> Array:
        """E D' for (m, P + E) rows."""
        rows: Array = (self.D @ E.T).T
        return rows

    def solve(self, B: Array) -> Array:
        """X of G X = B for (P, m) columns, by the sparse factors of G."""
        X: Array = self._factor.solve(np.asfortranarray(B))
        return X

    def solve_shifted(self, B: Array, shifts: Array, tol: float = 1e-14) -> Array:
        """X with X_i (G + k_i I) = B_i for each of the (m, P) rows, by conjugate gradients.

        G is near enough to the identity (spectrum from 1 to 1 + 2 w^2 degree) that m factorisations would cost more.
        """
        stop = tol**2 * np.einsum("ip,ip->i", B, B)
        return conjugate_gradients(
            lambda X: (self.G @ X.T).T + shifts[:, None] * X,
            B,
            lambda rho: bool((rho <= stop).all()),
            axis=1,
            max_steps=MOST_STEPS,
        )


@dataclass(frozen=True)
class SpatialProblem(PrintedProblem):
    """The printed Lagrangian with the spatial term; E and Y3 of the state are (P, P + edges)."""

    neighbours: Neighbours = field(kw_only=True)

    def start(self, b: float, S: Array | None = None) -> State:
        """S (by default pinv(R) W), S# = g(S), all else zero."""
        wide = np.zeros(self.neighbours.D.shape)
        return replace(super().start(b, S), E=wide, Y3=wide)

    def code_step(self, state: State) -> Array:
        """C of eq. (20): (S'S + 11') C + C G = S'S + S'Y2/b + 11' - 1 Y4/b + (E - Y3/b) D'."""
        V, H = self.code_rows(state)
        return self.solve_code(V, H, self.neighbours.gather(state.E - state.Y3 / state.b))

    def solve_code(self, V: Array, H: Array, N: Array) -> Array:
        """C of V'V C + C G = V'H + N for V, H (r, P) and N (P, P).

        With V'V = U'kU, U (r, P) orthonormal: B G^-1 for the right-hand side B answers all directions but those of U,
        C = B G^-1 + U' (U B (G + k)^-1 - U B G^-1).
        """
        B = V.T @ H + N
        _, s, U = scipy.linalg.svd(V, full_matrices=False, check_finite=False)
        seen = U @ B
        change: Array = U.T @ (self.neighbours.solve_shifted(seen, s**2) - self.neighbours.solve(seen.T).T)
        return self.neighbours.solve(B.T).T + change

    def sparse_step(self, state: State) -> Array:
        """E of eq. (18): soft threshold of C D + Y3/b at l1/b, the diagonal of its part for C zero."""
        E = soft(self.neighbours.differences(state.C) + state.Y3 / state.b, self.l1 / state.b)
        np.fill_diagonal(E[:, : len(E)], 0)
        return E

    def code_gap(self, state: State) -> Array:
        """C D - E."""
        gap: Array = self.neighbours.differences(state.C) - state.E
        return gap
