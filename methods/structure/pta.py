"""Non-rigid structure from motion in trajectory space: every point moves on a few cosines.

Akhter, Sheikh, Khan, Kanade, "Nonrigid structure from motion in trajectory space", NIPS 2008; "Trajectory space: a dual
representation for nonrigid structure from motion", PAMI 2011.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft

from nrsfm.methods.base import Array, Mask, Method, MethodError, Observations, Reconstruction, check_count, standardise

#: Weight of the velocities' energy where tracks do not determine the basis, in standardised units.
GAPS = 1e-3
#: Least over largest singular value of the system, below which whole tracks do not determine the basis.
DETERMINED = 1e-6


@dataclass(kw_only=True, eq=False, repr=False)
class PTA(Method):
    """Point trajectory approach: S# = Theta A, with Theta the first K vectors of the discrete cosine transform.

    Parameters
    ----------
    rank : int
        K, the vectors of the basis; the F x 3P structure S# has this rank. The authors choose it for each sequence.
    """

    provides = frozenset({"structure"})
    handles_gaps = True
    version = "2"

    rank: int = 9

    def reconstruct(self, observations: Observations, n_bodies: int | None = 1) -> Reconstruction:
        """See :meth:`nrsfm.methods.base.Method.reconstruct`; the number of bodies plays no part."""
        check_count(self, "rank")
        cameras, visible = observations.required_cameras(), observations.visible
        data = standardise(observations.tracks, visible)
        if self.rank > len(data.W):
            raise MethodError(f"PTA: rank is {self.rank}, but {len(data.W)} frames have as many vectors; lower it")
        observations.stage("structure")
        S = fit_trajectories(data.W, cameras, self.rank, visible)
        S -= S.mean(axis=2, keepdims=True)  # where there are no gaps it is centred already
        return Reconstruction(structure=S * data.scale, cameras=cameras)

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """Bytes of the structure, the tracks and the matrix of the system."""
        return 8.0 * (4 * 3 * n_frames * n_points + 4 * 2 * n_frames * 3 * min(self.rank, n_frames))


def trajectory_basis(n_frames: int, rank: int) -> Array:
    """Theta: the first vectors of the discrete cosine transform, (F, K) with orthonormal columns."""
    theta: Array = scipy.fft.idct(np.eye(n_frames, rank), axis=0, norm="ortho")
    return theta


def fit_trajectories(W: Array, cameras: Array, rank: int, visible: Mask | None = None) -> Array:
    """The (F, 3, P) structure on the basis that minimises |W - R S|: least squares for each point.

    W = R (Theta x I_3) A = Lambda A, (2F, 3K) times (3K, P), eq. (7) of the conference paper. Where tracks have gaps,
    hidden rows are left out, and the translation of such a frame is the visible points' mean. What is left hardly
    determines the basis: over half of the frames the cosines are nearly dependent. So :data:`GAPS` times the sum of
    k^2 |a_k|^2 over the vectors k is added, the energy of the points' velocities, which is free for a point at rest.
    The same is added where whole tracks do not determine the basis: where the least singular value of Lambda is below
    :data:`DETERMINED` of the largest, as for many vectors over few frames, or a camera that turns too little.

    Parameters
    ----------
    W : (F, 2, P) array
        Centred tracks.
    cameras : (F, 2, 3) array
    rank : int
        K, at most F.
    visible : (F, P) bool array, optional
    """
    F, _, P = W.shape
    Theta = trajectory_basis(F, rank)
    Lambda = np.einsum("fij,fk->fikj", cameras, Theta).reshape(2 * F, 3 * rank)
    velocity = np.diag(np.sqrt(GAPS) * np.repeat(np.arange(rank), 3))
    if visible is None:
        A, _, _, sizes = np.linalg.lstsq(Lambda, W.reshape(2 * F, P), rcond=None)
        if sizes[-1] < DETERMINED * sizes[0]:
            right = np.concatenate([W.reshape(2 * F, P), np.zeros((3 * rank, P))])
            A = np.linalg.lstsq(np.vstack([Lambda, velocity]), right, rcond=None)[0]
    else:
        A = np.empty((3 * rank, P))
        for p in range(P):
            seen = np.repeat(visible[:, p], 2)
            right = np.concatenate([W[:, :, p].reshape(2 * F)[seen], np.zeros(3 * rank)])
            A[:, p] = np.linalg.lstsq(np.vstack([Lambda[seen], velocity]), right, rcond=None)[0]
    S: Array = np.einsum("fk,kjp->fjp", Theta, A.reshape(rank, 3, P))
    return S
