"""Adaptive, with weights from the data: reconstruction and self-expression of whitened motion, with slack, in one ADMM.

    min  1/2 |W - U|^2 + l2 |S#|_* + e (1/2 |X - X C|^2 + l1 m |E|_1),  X = diag(w) Q'U diag(1/d)
    s.t. S# = L g(S),  U = R S,  C = E,  diag(C) = 0

after Kumar, Dai, Li, 3DV 2016, eq. (11). L makes the nuclear norm that of structure that moves smoothly
(:mod:`nrsfm.methods.structure.smooth_bmm`). U are the images of the structure, from which the code is read. Q are the
directions of image motion from smooth to rough (:func:`nrsfm.methods.multibody.motion.directions`). They are orthogonal
to the images of points at rest, so the bodies' offsets drop out and with them the affine constraint. w whitens their
spectrum, d are the tracks' norms in it, m is the weight above which the code of some track would vanish (Elhamifar,
Vidal, PAMI 2013, eq. 13), so l1 has no units. S = S C implies X = X C; the squared residual is the slack that real
bodies need: no point of a person is an exact combination of the others.

All weights depend on the noise sigma, which is estimated from the tracks. l2 is sigma times the largest singular value
of noise of unit variance; e, the weight of the slack against the image residual, is proportional to sigma^2; and from
clean to noisy tracks the spectrum is whitened less and the code made sparser.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nrsfm.methods import base
from nrsfm.methods.base import Array, Method, MethodError, Observations, Progress, Reconstruction
from nrsfm.methods.clustering.spectral import spectral_clustering
from nrsfm.methods.gaps import complete
from nrsfm.methods.multibody.motion import directions, noise_variance, spectrum
from nrsfm.methods.multibody.problem import DIAGONALS, Gaps, Problem, State, minimise, solve_code
from nrsfm.methods.numerics.admm import Admm
from nrsfm.methods.numerics.linear import symmetric_eigen, without_diagonal
from nrsfm.methods.numerics.proximal import soft
from nrsfm.methods.structure.smooth_bmm import (
    IMAGES,
    SMOOTHING,
    SmoothFit,
    Smoothness,
    fit_smooth,
)

#: The least noise that is assumed, in parts of the scene's spread; with less, R S = W to rounding.
FAINTEST = 3e-6


@dataclass(frozen=True, kw_only=True)
class AdaptiveProblem(Problem):
    """The augmented Lagrangian of the module's objective and its exact block updates; l1 is in units of m.

    Three penalties, none of which grows: b on S# = L g(S), a multiple of it on U = R S, and e m on C = E.
    """

    smoothness: Smoothness  # L

    expression: float  # e, the weight of the self-expression against the image residual
    Q: Array  # (2F, r), directions of image motion
    w: Array  # (r,), their weights
    d: Array  # (P,), norms of the tracks' weighted motion
    m: float  # the unit of l1

    def begin(self, fit: SmoothFit) -> State:
        """The state of the shape fit's solution without a code."""
        square = np.zeros((len(self.d),) * 2)
        Y1, Y5 = self.l2 * fit.multiplier, self.l2 * fit.images_multiplier
        S, b = fit.structure, self.l2 * fit.penalty
        return State(S=S, shape=fit.shape, U=fit.images, C=square, E=square, Y1=Y1, Y3=square, Y5=Y5, b=b)

    def update(self, state: State) -> State:
        """The steps of all problems, and then U."""
        state = super().update(state)
        return replace(state, U=self.image_step(state))

    def ordered(self, S: Array) -> Array:
        """L g(S)."""
        return self.smoothness.apply(S)

    def images(self, state: State) -> Array:
        """U."""
        U: Array = state.U
        return U

    def motion(self, state: State) -> Array:
        """X, (r, P)."""
        return whiten(self.Q, self.w, state.U) / self.d

    @property
    def code_penalty(self) -> float:
        """e m, the penalty of C = E."""
        return self.expression * self.m

    def code_step(self, state: State) -> Array:
        """C: (X'X/m + I) C = X'X/m + E - Y3/(e m). One Cholesky factorisation."""
        V = self.motion(state) / np.sqrt(self.m)
        return solve_code(V, V, state.E - state.Y3 / self.code_penalty, self.diagonal)

    def sparse_step(self, state: State) -> Array:
        """E: soft threshold of C + Y3/(e m) at l1, its diagonal zero."""
        E = soft(state.C + state.Y3 / self.code_penalty, self.l1)
        return without_diagonal(E) if self.diagonal == "threshold" else E

    def structure_step(self, state: State) -> Array:
        """S of one banded system."""
        U_shift = state.Y5 / self.penalty(state, "images")
        return self.smoothness.structure(state.shape + state.Y1 / state.b, state.U + U_shift)

    def image_step(self, state: State) -> Array:
        """U in closed form.

        With c the penalty of U = R S, (1 + c) U + e Q diag(w^2) Q'U B = W + c R S - Y5, where
        B = diag(1/d) (I - C)(I - C)' diag(1/d). Q and the eigenvectors of B make that diagonal. An eigendecomposition
        and products, O(2F P (r + P) + 9 P^3).
        """
        c = self.penalty(state, "images")
        P = len(self.d)
        rows = ((self.W + c * (self.cameras @ state.S) - state.Y5) / (1 + c)).reshape(-1, P)
        M = (np.eye(P) - state.C) / self.d[:, None]
        beta, V = symmetric_eigen(M @ M.T)
        stiffness = self.expression / (1 + c) * np.multiply.outer(self.w**2, np.maximum(beta, 0))
        rough = (self.Q.T @ rows) @ V * (stiffness / (1 + stiffness))
        U: Array = (rows - self.Q @ (rough @ V.T)).reshape(self.W.shape)
        return U

    def gaps(self, state: State) -> Gaps:
        """S# - L g(S), U - R S and C - E."""
        return {
            "shape": state.shape - self.ordered(state.S),
            "images": state.U - self.cameras @ state.S,
            "code": state.C - state.E,
        }

    def objective(self, state: State) -> float:
        """The module's objective."""
        fit = self.W - state.U
        X = self.motion(state)
        code = 0.5 * np.sum((X - X @ state.C) ** 2) + self.l1 * self.m * np.abs(state.E).sum()
        return float(0.5 * np.sum(fit**2) + self.l2 * state.nuclear_norm + self.expression * code)

    def penalty(self, state: State, name: str) -> float:
        """b of S# = L g(S), a multiple of it of U = R S, e m of C = E."""
        return {"shape": state.b, "images": IMAGES * state.b, "code": self.code_penalty}[name]

    def operations(self, state: State) -> float:
        """Multiplications and additions of an iteration, without lower orders.

        Four products of 2F x r with r x P, two of r x P with P x P, a symmetric product and a factor for C, a product
        and an eigendecomposition for U, and the threshold's F x F products.
        """
        F, _, P = state.S.shape
        r = len(self.w)
        code = 2.0 * P * (4 * 2 * F * r + 2 * r * P) + P * P * (r + P / 3 + 2 * P + 2 * P + 9 * P)
        return float(code + 12.0 * F * F * P)


def whiten(Q: Array, w: Array, images: Array) -> Array:
    """diag(w) Q' images, (r, P), for (F, 2, P) images."""
    return w[:, None] * (Q.T @ images.reshape(len(Q), -1))


@dataclass(kw_only=True, eq=False, repr=False)
class AdaptiveMultiBody(Method):
    """:class:`AdaptiveProblem` with weights from the noise sigma of the tracks.

    sigma is in parts of the scene's spread. With t = sigma / (sigma + ``noise``), which is 0 for clean tracks and 1
    for very noisy ones, a pair of settings (clean, noisy) means clean + t (noisy - clean).

    Parameters
    ----------
    l1 : pair of float
        Weight of |E|_1 in parts of the weight at which the code of some track vanishes.
    whitening : pair of float
        Directions of mean square v get the weight v^(-whitening/2): 1 whitens, 0 leaves the motion as it is.
    noise : float
        The sigma at which settings are half way between clean and noisy.
    floor : float
        In parts of the scene's spread: fainter motion is not amplified further.
    nuclear : float
        l2 in parts of sigma (sqrt(F) + sqrt(3P)), the largest singular value of F x 3P noise.
    expression : float
        Weight of the self-expression against the image residual, in parts of sigma^2.
    tol : float
        Stop when the infinity norms of all gaps between split variables are below it (the paper's epsilon).
    smoothing : float
        t of L, in frames.
    diagonal : {"threshold", "exact", "paper"}
        How diag(C) = 0 is kept, see :class:`nrsfm.methods.multibody.printed.MultiBody`.
    seed : int
        Of k-means.
    """

    provides = frozenset({"labels", "structure"})
    handles_gaps = True
    version = "5"

    l1: Sequence[float] = (0.1, 0.5)
    whitening: Sequence[float] = (0.7, 0.5)
    noise: float = 0.005
    floor: float = 0.02
    nuclear: float = 2.0
    smoothing: float = SMOOTHING
    expression: float = 10.0
    max_iter: int = 100
    tol: float = 1e-3
    diagonal: str = "threshold"
    seed: int = 0

    def reconstruct(self, observations: Observations, n_bodies: int | None) -> Reconstruction:
        """See :meth:`nrsfm.methods.base.Method.reconstruct`."""
        cameras, progress = observations.required_cameras(), observations.progress
        base.check_bodies(n_bodies, observations.tracks.shape[2], least=1)
        self._check_settings()
        if observations.visible is not None:
            observations.stage("gaps")
        data = base.standardise(complete(observations.tracks, observations.visible))
        observations.stage("weights")
        problem, state = self.adapt(data.W, cameras, progress)
        observations.stage("structure and code")
        admm = Admm(self.max_iter, self.tol, state.b, progress=progress)
        state, history = minimise(problem, state, admm, observations.visible)
        affinity = np.abs(state.E) + np.abs(state.E.T)
        observations.stage("clustering")
        return Reconstruction(
            labels=spectral_clustering(affinity, n_bodies, seed=self.seed),
            structure=state.S * data.scale,
            cameras=cameras,
            affinity=affinity,
            history=history,
        )

    def adapt(self, W: Array, cameras: Array, progress: Progress | None = None) -> tuple[AdaptiveProblem, State]:
        """The problem with the weights for centred (F, 2, P) tracks, and the state to start from."""
        F, _, P = W.shape
        Q = directions(cameras)
        motion = Q.T @ W.reshape(2 * F, P)
        if not np.abs(motion).max() > 1e-9:
            raise MethodError("nothing moves in 3D but the camera; bodies are told apart by how they move")
        sigma = max(float(np.sqrt(noise_variance(motion))), FAINTEST)
        t = sigma / (sigma + self.noise)
        l1, whitening = (clean + t * (noisy - clean) for clean, noisy in (self.l1, self.whitening))
        l2 = self.nuclear * sigma * (np.sqrt(F) + np.sqrt(3 * P))
        smoothness = Smoothness(cameras, self.smoothing)
        fit = fit_smooth(W, smoothness, l2, progress=progress)
        w = (spectrum(motion) + self.floor**2) ** (-whitening / 2)
        X = whiten(Q, w, fit.images)
        norms = np.linalg.norm(X, axis=0)
        d = np.hypot(norms, 1e-3 * norms.max())  # keeps tracks at rest out of the code
        G = np.abs(X.T @ X) / np.outer(d, d)
        np.fill_diagonal(G, 0)
        m = float(G.max(axis=0).min())
        e = self.expression * sigma**2
        problem = AdaptiveProblem(
            W=W,
            cameras=cameras,
            l1=l1,
            l2=l2,
            diagonal=self.diagonal,
            smoothness=smoothness,
            expression=e,
            Q=Q,
            w=w,
            d=d,
            m=m,
        )
        return problem, problem.begin(fit)

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """Bytes of the P x P arrays, those of the structure, and the directions."""
        return 8.0 * (12 * n_points**2 + 20 * 3 * n_frames * n_points + 5 * (3 * n_frames) ** 2)

    def _check_settings(self) -> None:
        base.check_word(self, "diagonal", DIAGONALS)
        base.check_positive(self, "noise", "nuclear", "expression", "tol", "floor")
        base.check_at_least(self, 0, "smoothing")
        base.check_count(self, "max_iter")
        for name in ("l1", "whitening"):
            values: Any = getattr(self, name)
            numbers = isinstance(values, Sequence) and [isinstance(v, int | float) and v >= 0 for v in values]
            if numbers != [True, True]:
                raise MethodError(
                    f"AdaptiveMultiBody: {name} is {values!r}, wanted two numbers >= 0: [for clean, for noisy tracks]"
                )
