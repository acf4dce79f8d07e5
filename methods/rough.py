"""The self-expression of rough motion: what the images show beyond any smooth motion of the scene in 3D.

The bodies' mean shapes and slow motions lie in one common low-dimensional space, so that they express each other across
bodies; a code of whole trajectories is bound by that space. A smooth 3D trajectory on K vectors of a DCT basis
projects into span(R (Theta x I_3)), 3K of the 2F dimensions of the images. With N the projector onto the rest,
N W is free of the common part whatever the depth is, and since S = S C implies N R S = N R S C, the code of

    min  1/2 |W - R S|^2 + l2 |S#|_* + e (1/2 |X - X C|^2 + l1 m |E|_1),  X = N R S
    s.t. S# = g(S),  C = E,  diag(C) = 0

is bound by the bodies' own motions alone. m is the weight above which the code of N W would be zero for some track
(Elhamifar, Vidal, PAMI 2013, eq. 13), so l1 has no units. The affine constraint 1'C = 1' falls: it stands for the
bodies' offsets, and N removes those. The squared residual in place of S = S C is the slack that real bodies need:
of 41 points of a person none is an exact combination of the others. The nuclear norm and the slack both distort the
faint rough motion that the code reads, so l2 and e are small: the noise-free limit R S = W.

Trajectory basis: Akhter, Sheikh, Khan, Kanade, "Trajectory space", PAMI 2011.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import ceil

import numpy as np
import scipy.fft
import scipy.linalg

from methods.base import Array, MethodError
from methods.cameras import axes
from methods.lagrangian import Problem, State, gram, shifted_cholesky
from methods.proximal import soft


def smooth_images(cameras: Array, period: float) -> Array:
    """Orthonormal basis of the image tracks of all 3D trajectories that are slower than ``period`` frames.

    Returns
    -------
    (2F, 3K) array
        K = ceil(2F / period) vectors of the DCT, as vector k has a period of 2F/k frames.

    Raises
    ------
    MethodError
        If nothing would be left of the 2F dimensions.
    """
    F = len(cameras)
    K = ceil(2 * F / period)
    if 3 * K >= 2 * F:
        raise MethodError(f"method.period is {period}, wanted more than {6 * F / (2 * F - 3):.3g} frames")
    theta = scipy.fft.idct(np.eye(F, K), axis=0, norm="ortho")
    images = np.einsum("fij,fk->fijk", cameras, theta).reshape(2 * F, 3 * K)
    return np.linalg.qr(images)[0]


@dataclass(frozen=True)
class RoughProblem(Problem):
    """The Lagrangian of the module's objective and its exact block updates; Y2 and Y4 of the state stay zero.

    Two penalties: b on S# = g(S), which grows, and the constant e m on C = E, which does not, since a
    penalty that grows would freeze the code before it has converged.

    Parameters
    ----------
    expression : float
        The weight e of the self-expression against the image residual.
    period : float
        In frames; smooth motion is what is slower.
    """

    expression: float = 0.01
    period: float = 16.0
    smooth: Array = field(init=False)
    scale: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "smooth", smooth_images(self.cameras, self.period))
        X = self.rough(self.W.reshape(-1, self.W.shape[2]))
        G = np.abs(X.T @ X)
        np.fill_diagonal(G, 0)
        scale = float(G.max(axis=0).min())
        if not scale > 1e-20:
            raise MethodError(f"some track has no motion faster than method.period = {self.period} frames; raise it")
        object.__setattr__(self, "scale", scale)

    def rough(self, tracks: Array) -> Array:
        """N X for (2F, P) image tracks."""
        return tracks - self.smooth @ (self.smooth.T @ tracks)

    def images(self, state: State) -> Array:
        """N R S, (2F, P)."""
        return self.rough((self.cameras @ state.S).reshape(-1, state.S.shape[2]))

    @property
    def code_penalty(self) -> float:
        return self.expression * self.scale

    def code_step(self, state: State) -> Array:
        """C: (X'X/m + I) C = X'X/m + E - Y3/(e m). One Cholesky factorisation, see ``solve_code``."""
        V = self.images(state) / np.sqrt(self.scale)
        return self.solve_code(V, V, state.E - state.Y3 / self.code_penalty)

    def sparse_step(self, state: State) -> Array:
        """E: soft threshold of C + Y3/(e m) at l1, its diagonal zero."""
        E = soft(state.C + state.Y3 / self.code_penalty, self.l1)
        if self.diagonal == "threshold":
            np.fill_diagonal(E, 0)
        return E

    def structure_step(self, state: State) -> Array:
        """S in closed form.

        In each frame's own axes R'R = diag(1, 1, 0): with V = S# + Y1/b, depth rows are V's, and image rows X solve
        (1 + b) X + e N X B = W + b V, B = (I - C)(I - C)'. N is a projector, so the smooth part of the right-hand side
        is divided by 1 + b, and the rough part solves X (e B + (1 + b) I) = rhs. One P x P factorisation and
        products, O(2F P (P + 3K) + P^3).
        """
        b = state.b
        F, _, P = state.S.shape
        Q = axes(self.cameras)
        V = Q @ (state.shape + state.Y1 / b)
        rhs = (self.W + b * V[:, :2]).reshape(-1, P)
        rough = self.rough(rhs)
        M = np.eye(P) - state.C
        factor = shifted_cholesky(self.expression * gram(M.T), 1 + b)
        rows = (rhs - rough) / (1 + b) + scipy.linalg.cho_solve(factor, rough.T, check_finite=False).T
        V[:, :2] = rows.reshape(F, 2, P)
        return Q.transpose(0, 2, 1) @ V

    def gaps(self, state: State) -> dict[str, Array]:
        """S# - g(S) and C - E."""
        return {"shape": state.shape - state.S, "code": state.C - state.E}

    def multiplier_step(self, state: State, gaps: dict[str, Array]) -> State:
        """Y1 += b (S# - g(S)), Y3 += e m (C - E)."""
        return replace(state, Y1=state.Y1 + state.b * gaps["shape"], Y3=state.Y3 + self.code_penalty * gaps["code"])

    def residual(self, state: State) -> Array:
        """X - X C, (2F, P)."""
        X = self.images(state)
        return X - X @ state.C

    def objective(self, state: State) -> float:
        """The module's objective."""
        fit = self.W - self.cameras @ state.S
        code = 0.5 * np.sum(self.residual(state) ** 2) + self.l1 * self.scale * np.abs(state.E).sum()
        return float(0.5 * np.sum(fit**2) + self.l2 * state.nuclear_norm + self.expression * code)

    def lagrangian(self, state: State) -> float:
        """The augmented Lagrangian whose blocks the steps minimise; for checks, as it costs a decomposition."""
        flat = state.shape.reshape(len(state.shape), -1)
        value = self.objective(replace(state, nuclear_norm=float(np.linalg.norm(flat, "nuc"))))
        gaps = self.gaps(state)
        for Y, gap, b in ((state.Y1, gaps["shape"], state.b), (state.Y3, gaps["code"], self.code_penalty)):
            value += float(np.sum(Y * gap) + b / 2 * np.sum(gap**2))
        return value
