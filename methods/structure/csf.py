"""Non-rigid structure from motion by column space fitting: shapes whose coefficients change smoothly over time.

    S# = sum_k c_k B_k,   c_k = Theta x_k

with basis shapes B_k and coefficients on Theta (F, d), the first vectors of the discrete cosine transform. The shapes
are eliminated by least squares (variable projection), so that the x_k are the only unknowns.

Gotardo, Martinez, "Computing smooth time-trajectories for camera and deformable shape in structure from motion with
occlusion", PAMI 2011 (CSF); "Non-rigid structure from motion with complementary rank-3 spaces", CVPR 2011 (CSF2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.optimize

from nrsfm.methods import base
from nrsfm.methods.base import Array, Method, MethodError, Observations, Progress, Reconstruction
from nrsfm.methods.structure.pta import trajectory_basis


@dataclass(kw_only=True, eq=False, repr=False)
class CSF(Method):
    """Column space fitting with given cameras.

    Parameters
    ----------
    rank : int
        K, the basis shapes. The authors choose it for each sequence.
    together : bool
        Fit all shapes to the tracks at once (CSF), or each to what those before it leave (CSF2).
    basis : float
        d, the vectors of the basis, in parts of the frames; at least K.
    max_iter : int
    tol : float
        Stop when an iteration lowers the residual's square by a smaller share.
    """

    provides = frozenset({"structure"})

    rank: int = 5
    together: bool = False
    basis: float = 0.1
    max_iter: int = 3000
    tol: float = 1e-10

    def reconstruct(self, observations: Observations, n_bodies: int | None = 1) -> Reconstruction:
        """See :meth:`nrsfm.methods.base.Method.reconstruct`; the number of bodies plays no part."""
        base.check_count(self, "rank", "max_iter")
        base.check_positive(self, "basis", "tol")
        cameras = observations.required_cameras()
        data = base.standardise(observations.tracks)
        F = len(data.W)
        if self.rank > F:
            raise MethodError(f"CSF: rank is {self.rank}, but {F} frames have as many vectors; lower it")
        observations.stage("structure")
        fit = ColumnSpaces(data.W, cameras, self._vectors(F), 1 if self.together else self.rank)
        C = fit.minimise(self.rank, self.max_iter, self.tol, observations.progress)
        return Reconstruction(structure=fit.structure(C) * data.scale, cameras=cameras)

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """Bytes of the tracks' residuals, one a shape, the structure, and the optimiser's vectors."""
        spaces = 1 if self.together else self.rank
        images, vectors = 2 * n_frames * n_points, self._vectors(n_frames)
        return 8.0 * (
            (spaces + 8) * images + 4 * 3 * n_frames * n_points + vectors * (3 * HISTORY * self.rank + n_frames)
        )

    def _vectors(self, n_frames: int) -> int:
        return min(n_frames, max(self.rank, round(self.basis * n_frames)))


#: Pairs of steps and gradients that L-BFGS keeps.
HISTORY = 30


class Space(NamedTuple):
    """What one column space leaves of the tracks."""

    Q: Array  # orthonormal basis of the columns of M, (2F, r)
    inverse: Array  # M^+ = inverse Q', (3k, r)
    shapes: Array  # B = M^+ E of the residual E before, (3k, P)
    rest: Array  # E - M B, (2F, P)


@dataclass(frozen=True)
class ColumnSpaces:
    """f(X) = 1/2 |E_n|^2 with E_0 = W, E_i = E_(i-1) - M_i B_i, B_i = M_i^+ E_(i-1), M_i = R (C_i x I_3), C = Theta X.

    The K columns of C are shared out to n spaces in order.
    """

    W: Array  # (F, 2, P)
    cameras: Array  # (F, 2, 3)
    vectors: int  # d
    spaces: int  # n: 1 or K

    @property
    def Theta(self) -> Array:
        return trajectory_basis(len(self.W), self.vectors)

    def minimise(self, rank: int, max_iter: int, tol: float, progress: Progress | None = None) -> Array:
        """Coefficients C (F, K) by L-BFGS from the first K vectors, where CSF is the point trajectory approach."""
        Theta = self.Theta
        count = 0

        def cost(x: Array) -> tuple[float, Array]:
            f, by_C = self.cost(Theta @ x.reshape(-1, rank))
            return f, (Theta.T @ by_C).ravel()

        def report(intermediate_result: scipy.optimize.OptimizeResult) -> None:
            nonlocal count
            count += 1
            if progress is not None:
                progress(count, max_iter, {"objective": float(intermediate_result.fun)})

        options = {"maxiter": max_iter, "maxfun": 2 * max_iter, "maxcor": HISTORY, "ftol": tol, "gtol": 0.0}
        start = np.eye(self.vectors, rank).ravel()
        found = scipy.optimize.minimize(cost, start, jac=True, method="L-BFGS-B", callback=report, options=options)
        C: Array = Theta @ found.x.reshape(-1, rank)
        return C

    def cost(self, C: Array) -> tuple[float, Array]:
        """f and its gradient by C, (F, K).

        With the projector Pi = M M^+, d(Pi) = (I - Pi) dM M^+ + its transpose. Back from A_n = E_n by
        A_(i-1) = (I - Pi_i) A_i, the derivative by M_i is -(A_(i-1) B_i' + E_i (M_i^+ A_i)'). The papers leave its
        second half out, which is 0 in the last space alone.
        """
        steps = self.fit(C)
        A = steps[-1].rest
        gradients = []
        for step in reversed(steps):
            QA = step.Q.T @ A
            A = A - step.Q @ QA
            G = A @ step.shapes.T + step.rest @ (step.inverse @ QA).T
            gradients.append(np.einsum("fikj,fij->fk", G.reshape(*self.cameras.shape[:2], -1, 3), self.cameras))
        return 0.5 * float(np.sum(steps[-1].rest ** 2)), -np.concatenate(gradients[::-1], axis=1)

    def fit(self, C: Array) -> list[Space]:
        """The spaces of the coefficients in order; where cameras do not determine a shape, that of the least norm."""
        steps = []
        E = self.W.reshape(-1, self.W.shape[2])
        for columns in np.split(C, self.spaces, axis=1):
            M = np.einsum("fij,fk->fikj", self.cameras, columns).reshape(len(E), -1)
            U, s, Vt = np.linalg.svd(M, full_matrices=False)
            kept = s > 1e-9 * s[0]
            Q, inverse = U[:, kept], Vt[kept].T / s[kept]
            QE = Q.T @ E
            E = E - Q @ QE
            steps.append(Space(Q, inverse, inverse @ QE, E))
        return steps

    def structure(self, C: Array) -> Array:
        """S# = C B as an (F, 3, P) structure."""
        B = np.concatenate([step.shapes for step in self.fit(C)])
        S: Array = np.einsum("fk,kjp->fjp", C, B.reshape(C.shape[1], 3, -1))
        return S
