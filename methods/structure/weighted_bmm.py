"""Single-body non-rigid structure from motion by a weighted nuclear norm: small singular values cost more.

    min over S   mu sum_i theta_i sigma_i(S#) + 1/2 |W - R S|^2,   theta_i = xi sqrt(sigma_1) / (sigma_i + gamma)

with sigma the singular values of the structure without depth, S# = g(R'W), and theta = 0 for the first N of them. N = 0
is R-BMM's shape step and N = 1 that of organic priors. The weights are fixed once.

Kumar, "Non-rigid structure from motion: prior-free factorization method revisited", WACV 2020; Kumar, Van Gool,
"Organic priors in non-rigid structure from motion", ECCV 2022.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from nrsfm.methods import base
from nrsfm.methods.base import Array, Mask, Progress
from nrsfm.methods.gaps import misfit
from nrsfm.methods.numerics.admm import Admm
from nrsfm.methods.numerics.proximal import weighted_singular_value_threshold
from nrsfm.methods.structure.bmm import ShapeMethod


@dataclass(kw_only=True, eq=False, repr=False)
class WeightedBMM(ShapeMethod):
    """The weighted nuclear norm under a penalty that grows from next to nothing.

    The penalty's schedule is part of the method: the thresholds theta / b run from more than every singular value to
    nothing, so that the structure's rank grows from N upwards and depth follows what has been let in before. The result
    depends on the schedule and is no minimiser of the printed objective, which is concave in the singular values.

    Parameters
    ----------
    free : int
        N, the leading singular values that cost nothing.
    weight : float
        xi, in parts of sqrt(sigma_1).
    gamma : float
        Keeps weights finite, in standardised units.
    penalty, growth, max_penalty : float
        b at the start, its factor per iteration, and its limit, at which the iteration ends.
    rank : int or None
        Cut the F x 3P structure to this rank afterwards.
    tol : float
        Stop when no entry of S# and g(S) differs by more, in standardised units.

    References
    ----------
    Kumar, Van Gool, ECCV 2022, eq. (11) and algorithm 1.
    """

    free: int = 1
    weight: float = 5e-3
    gamma: float = 1e-6
    penalty: float = 1e-4
    growth: float = 1.1
    max_penalty: float = 1e10
    tol: float = 1e-10

    def _check_settings(self) -> None:
        base.check_positive(self, "weight", "gamma", "penalty", "max_penalty", "tol")
        base.check_at_least(self, 1, "growth")
        base.check_count(self, "free", least=0)

    def _fit(self, W: Array, cameras: Array, visible: Mask | None, progress: Progress | None) -> Array:
        F, _, P = W.shape
        Rt = cameras.transpose(0, 2, 1)
        S = Rt @ W
        Z, Y = S.copy(), np.zeros_like(S)  # S#, and the scaled multiplier of g(S) = S#
        sigma = scipy.linalg.svdvals(S.reshape(F, 3 * P))
        theta = self.weight * np.sqrt(sigma[0]) / (sigma + self.gamma)
        theta[: self.free] = 0
        steps = int(np.log(self.max_penalty / self.penalty) / np.log(self.growth)) + 1
        admm = Admm(steps, self.tol, self.penalty, growth=self.growth, progress=progress)
        for b in admm:
            V = Z + Y
            S = V + Rt @ misfit(W, cameras @ V, visible) / (1 + b)
            Z = weighted_singular_value_threshold((S - Y).reshape(F, 3 * P), theta / b).reshape(F, 3, P)
            Y = (Y + Z - S) / self.growth
            admm.report(primal=float(np.abs(Z - S).max()))
        return S
