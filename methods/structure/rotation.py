"""Cameras from tracks alone: the rotation step of the block matrix method.

Dai, Li, He, "A simple prior-free method for non-rigid structure-from-motion factorization", CVPR 2012; IJCV 2014.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import least_squares

from nrsfm.methods.base import Array, MethodError, standardise
from nrsfm.methods.numerics.admm import balancing_factor

#: Weights of the metric constraints to start from: low ones suit noisy tracks, high ones an exact subspace.
WEIGHTS = (1e0, 1e1, 1e3)
#: Number of shapes K by default.
RANK = 11
#: Where the metric upgrade starts from: the trace-norm program, or the metric upgrade of a rigid scene.
STARTS = ("trace_norm", "rigid")


@dataclass(frozen=True)
class GramFit:
    """Gram matrix of the metric upgrade: (n, n) Q, its objective, a lower bound of the optimum, iterations."""

    Q: Array
    objective: float
    bound: float
    iterations: int

    @property
    def gap(self) -> float:
        """Upper bound of the objective's excess over the optimum, relative to the objective."""
        return (self.objective - self.bound) / self.objective


def estimate_cameras(tracks: Array, rank: int = RANK, *, start: str = "trace_norm", refine: bool = True) -> Array:
    """Orthographic cameras of a non-rigid scene, by factorisation to rank 3K and metric upgrade.

    The centred tracks are cut to rank 3K, W = M B with M = U sqrt(D); :func:`metric_upgrade` finds G, and each pair of
    rows of M G is replaced by the nearest orthonormal pair. Cameras are known up to one orthogonal matrix for the
    sequence.

    Parameters
    ----------
    tracks : (F, 2, P) array
        At least three frames and four points.
    rank : int
        The number of shapes K. Where the tracks have lower rank than 3K, or 3K > 2F/3 (then the 2F constraints no
        longer determine G), as many columns are kept as these allow.
    start : {"trace_norm", "rigid"}
        See :func:`metric_upgrade`.
    refine : bool
        Refine the metric upgrade; without it G is where it started.

    Returns
    -------
    (F, 2, 3) array

    Raises
    ------
    MethodError
        If the tracks are too few, flat (of rank less than 3), or coincide in a row of a frame; or K < 1; or the start
        is unknown.

    References
    ----------
    Dai, Li, He, IJCV 2014, section 3 (the trace-norm minimisation and its refinement).
    """
    M = factor(standardise(tracks).W, rank)
    G, _ = metric_upgrade(M, start, refine)
    return orthonormal_rows(M @ G)


def factor(W: Array, rank: int) -> Array:
    """The left factor M = U sqrt(D), (F, 2, n), of centred tracks (F, 2, P) cut to rank n <= 3K."""
    F, _, P = W.shape
    if isinstance(rank, bool) or not isinstance(rank, int | np.integer) or rank < 1:
        raise MethodError(f"cameras.rank is {rank!r}, wanted a whole number of at least 1")
    if F < 3 or P < 4:
        raise MethodError(f"cameras cannot be estimated from {F} frames and {P} tracks; at least 3 and 4 are needed")
    U, d, _ = np.linalg.svd(W.reshape(2 * F, P), full_matrices=False)
    n = min(3 * rank, max(3, 2 * F // 3), int((d > 1e-9 * d[0]).sum()))
    if n < 3:
        raise MethodError(
            "cameras cannot be estimated: the tracks have rank less than 3 (a flat scene or a fixed camera)"
        )
    M: Array = (U[:, :n] * np.sqrt(d[:n])).reshape(F, 2, n)
    lengths = np.linalg.norm(M, axis=2)
    empty = np.flatnonzero((lengths < 1e-9 * lengths.max()).any(axis=1))
    if len(empty):
        raise MethodError(f"cameras cannot be estimated: in frame {empty[0]} all tracks have the same x or the same y")
    return M


def orthonormality(tracks: Array, cameras: Array, rank: int = RANK) -> float:
    """How far (F, 2, 3) cameras are from the factorisation of (F, 2, P) tracks to rank 3K: rms over rows of M G - R.

    G is the best one for the cameras. 0 for the cameras of tracks of that rank. Where it is not, the metric constraints
    cannot be met, and the cameras are wrong by many times as much.
    """
    M = factor(standardise(tracks).W, rank)
    M, R = M.reshape(-1, M.shape[2]), cameras.reshape(-1, 3)
    off = M @ np.linalg.lstsq(M, R, rcond=None)[0] - R
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def metric_upgrade(M: Array, start: str = "trace_norm", refined: bool = True) -> tuple[Array, float]:
    """G (n, 3) that makes the rows of M G orthogonal and of one length per frame, and the sum of squares that is left.

    From ``trace_norm``, the Gram matrix Q = G G' comes from :func:`fit_gram`, once for every weight of :data:`WEIGHTS`;
    from ``rigid``, from the first three columns of M alone, as if the scene were rigid. The best factors of rank 3 are
    refined by :func:`refine`, and the one of least residual is kept. With several shapes the residual is flat: K
    triples of columns solve an exact problem, and so do their mixtures, so that cameras a few degrees off fit nearly as
    well as the right ones.

    References
    ----------
    Dai, Li, He, IJCV 2014, section 3; for a rigid scene, Tomasi, Kanade, "Shape and motion from image streams under
    orthography: a factorization method", IJCV 1992, section 3.
    """
    if start not in STARTS:
        raise MethodError(f"cameras.start is {start!r}, wanted one of {', '.join(STARTS)}")
    if not isinstance(refined, bool):
        raise MethodError(f"cameras.refine is {refined!r}, wanted true or false")
    if start == "rigid":
        starts = [np.pad(_rank_three(fit_gram(M[:, :, :3]).Q), ((0, M.shape[2] - 3), (0, 0)))]
    else:
        starts = [_rank_three(fit_gram(M, weight).Q) for weight in WEIGHTS]
    upgrades = [refine(M, G) if refined else (G, float(np.sum(residuals(M, G) ** 2))) for G in starts]
    return min(upgrades, key=lambda upgrade: upgrade[1])


def fit_gram(M: Array, weight: float = 1e3, *, max_iter: int = 3000, tol: float = 1e-5) -> GramFit:
    """The Gram matrix of least trace that meets the metric constraints as well as the tracks allow, by ADMM.

        min  tr(Q) / t + w / 2F  sum_f (m1 Q m1' - m2 Q m2')^2 + (2 m1 Q m2')^2
        s.t. Q positive semidefinite,  sum_f m1 Q m1' + m2 Q m2' = 2F

    with rows m1, m2 of M in frame f, and t the trace of the multiple of I that meets the last constraint. Real tracks
    are only nearly of rank 3K, so that no Q meets every constraint; w -> infinity is the constrained problem. The
    side condition does not depend on the basis of M (a change M T and T^-1 Q T^-1' leaves it as it is); the trace
    does, and is meant for M = U sqrt(D).

    Steps on the split x = z, svec(Q) in R^(n(n+1)/2): a linear solve in the eigenvectors of A'A, made once, and
    the projection onto the semidefinite cone. For any vector r, with C = I/t + (w/F) sum_i r_i A_i,

        2F lambda_min(C, M'M) - w |r|^2 / 2F  <=  the optimum,

    because the square is convex; r = A x makes it tight.

    M is (F, 2, n); Q, which is feasible exactly, (n, n). The weight w has no unit. The iteration stops when the gap
    between objective and bound, relative to the objective, is below ``tol``.

    References
    ----------
    Dai, Li, He, IJCV 2014, section 3; Boyd, Parikh, Chu, Peleato, Eckstein, "Distributed optimization and statistical
    learning via the alternating direction method of multipliers", 2011, section 3.
    """
    F, _, n = M.shape
    A = constraints(M)
    H = np.einsum("fri,frj->ij", M, M)
    t = 2 * F * n / float(np.trace(H))
    e, V = np.linalg.eigh(A.T @ A)
    e = weight / F * np.maximum(e, 0)
    trace, h = svec(np.eye(n)) @ V / t, svec(H) @ V
    z = h * (2 * F / (h @ h))
    u = np.zeros_like(z)
    b = float(np.linalg.norm(trace) / np.linalg.norm(z))
    fit = GramFit(np.eye(n), np.inf, -np.inf, 0)
    for iteration in range(1, max_iter + 1):
        inverse = 1 / (e + b)
        x = inverse * (b * (z - u) - trace)
        x += inverse * h * ((2 * F - h @ x) / (h @ (inverse * h)))
        relaxed, before = 1.6 * x + (1 - 1.6) * z, z
        w, U = np.linalg.eigh(smat(V @ (relaxed + u), n))
        Z = (U * np.maximum(w, 0)) @ U.T  # the nearest semidefinite matrix
        z = svec(Z) @ V
        u += relaxed - z
        if iteration % 10 == 0:
            q = z * (2 * F / (h @ z))
            C = smat(V @ (trace + e * x), n)
            lowest = eigh(C, H, eigvals_only=True, subset_by_index=[0, 0])[0]
            objective = float(trace @ q + 0.5 * (e * q) @ q)
            bound = max(fit.bound, 2 * F * float(lowest) - float(0.5 * (e * x) @ x))
            fit = GramFit(Z * (2 * F / (h @ z)), objective, bound, iteration)
            if fit.gap < tol:
                break
            primal = float(np.linalg.norm(x - z) / np.linalg.norm(z))
            dual = float(b * np.linalg.norm(z - before) / np.linalg.norm(trace))
            if iteration < max_iter // 2:
                change = balancing_factor(primal, dual)
                b *= change
                u /= change
    return fit


def constraints(M: Array) -> Array:
    """Rows A with A svec(Q) = (m1 Q m1' - m2 Q m2', 2 m1 Q m2'): (2F, n(n+1)/2) from (F, 2, n)."""
    m1, m2 = M[:, 0], M[:, 1]
    i, j = np.triu_indices(M.shape[2])
    scale = np.where(i == j, 1.0, np.sqrt(2.0))
    between = m1[:, i] * m2[:, j] + m1[:, j] * m2[:, i]
    return np.concatenate([m1[:, i] * m1[:, j] - m2[:, i] * m2[:, j], between]) * scale


def svec(Q: Array) -> Array:
    """The upper triangle of a symmetric matrix, off-diagonals times sqrt 2, which preserves inner products."""
    i, j = np.triu_indices(len(Q))
    return Q[i, j] * np.where(i == j, 1.0, np.sqrt(2.0))


def smat(q: Array, n: int) -> Array:
    """The symmetric (n, n) matrix of an upper triangle by :func:`svec`."""
    i, j = np.triu_indices(n)
    Q = np.zeros((n, n))
    Q[i, j] = Q[j, i] = q / np.where(i == j, 1.0, np.sqrt(2.0))
    return Q


def refine(M: Array, G: Array, max_evaluations: int = 100) -> tuple[Array, float]:
    """Refine an (n, 3) factor by least squares on :func:`residuals`; returns it with the sum of squares."""
    shape = G.shape
    solution = least_squares(
        lambda g: residuals(M, g.reshape(shape)),
        G.ravel(),
        jac=lambda g: jacobian(M, g.reshape(shape)),
        x_scale="jac",
        ftol=1e-12,
        xtol=1e-12,
        gtol=1e-15,
        max_nfev=max_evaluations,
    )
    return solution.x.reshape(shape), 2 * float(solution.cost)


def residuals(M: Array, G: Array) -> Array:
    """1 - |b|^2/|a|^2 of all frames, then 2 a.b/|a|^2, with a = m1 G, b = m2 G: (2F,) from (F, 2, n) and (n, 3).

    They do not depend on the scale of a frame, so that every frame has the same weight.
    """
    a, b = (M @ G).transpose(1, 0, 2)
    aa = (a * a).sum(axis=1)
    return np.concatenate([1 - (b * b).sum(axis=1) / aa, 2 * (a * b).sum(axis=1) / aa])


def jacobian(M: Array, G: Array) -> Array:
    """Derivatives of :func:`residuals` by the entries of G, row by row: (2F, 3n)."""
    a, b = (M @ G).transpose(1, 0, 2)
    aa, bb, ab = ((x * y).sum(axis=1, keepdims=True) for x, y in ((a, a), (b, b), (a, b)))
    by_a = np.concatenate([2 * bb / aa**2 * a, 2 / aa * b - 4 * ab / aa**2 * a])
    by_b = np.concatenate([-2 / aa * b, 2 / aa * a])
    m1, m2 = (np.tile(M[:, row], (2, 1)) for row in (0, 1))
    derivatives: Array = (m1[:, :, None] * by_a[:, None] + m2[:, :, None] * by_b[:, None]).reshape(len(m1), -1)
    return derivatives


def orthonormal_rows(A: Array) -> Array:
    """Nearest pairs of orthonormal rows to (F, 2, 3) matrices, each frame's sign following the frame before.

    A pair and its negative explain the same motion of the rows; the one nearer to the frame before is kept.
    """
    U, _, Vt = np.linalg.svd(A, full_matrices=False)
    R: Array = U @ Vt
    agreement = np.einsum("fij,fij->f", R[1:], R[:-1])
    R[1:] *= np.cumprod(np.where(agreement < 0, -1.0, 1.0))[:, None, None]
    return R


def _rank_three(Q: Array) -> Array:
    """G (n, 3) with G G' the best approximation of Q of rank 3; columns that vanish get a thousandth of the first."""
    w, V = np.linalg.eigh(Q)
    G: Array = V[:, -3:] * np.sqrt(np.maximum(w[-3:], 1e-6 * w[-1]))
    return G
