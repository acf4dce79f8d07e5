"""RigidDepth: one rigid shape for all frames, and k-means of the tracks.

An example to start from. It takes arrays and gives a Reconstruction, and knows nothing of files or experiments.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import KMeans

from nrsfm.methods.base import (
    Array,
    Mask,
    Method,
    MethodError,
    Progress,
    Reconstruction,
    check_bodies,
    check_cameras,
    check_setting,
    standardise,
)
from nrsfm.methods.gaps import complete


class RigidDepth(Method):
    """The depths of the best rigid shape, and k-means.

    Parameters
    ----------
    restarts : int
        Starts of k-means; the tightest clusters are kept.
    seed : int
        Of k-means.
    """

    provides = frozenset({"labels", "structure"})  # what it computes; a method may give one of them alone
    version = "1"  # raise it whenever results change, so that finished trials are run again

    def __init__(self, *, restarts: int = 20, seed: int = 0) -> None:
        self.restarts = restarts  # stored as it is and nothing else; the configuration gives it by this name
        self.seed = seed

    def reconstruct(
        self,
        tracks: Array,
        cameras: Array,
        n_bodies: int | None,
        *,
        visible: Mask | None = None,
        edges: NDArray[np.int64] | None = None,
        progress: Progress | None = None,
    ) -> Reconstruction:
        """(F, 2, P) tracks and (F, 2, 3) cameras in; labels (P,) and structure (F, 3, P) out.

        W = R_f s for all frames f gives the rigid shape s by least squares. S_f = s + R_f' (w_f - R_f s) then meets
        every image exactly, and has the depths of s.
        """
        check_setting(self, "restarts", 1, strict=False, whole=True)
        data = standardise(complete(tracks, visible))  # centred, of unit spread, and checked
        W = data.W
        n_points = W.shape[2]
        check_cameras(cameras, len(W))
        check_bodies(n_bodies, n_points)
        if n_bodies is None:
            raise MethodError("RigidDepth cannot tell how many bodies there are; set n_bodies")
        shape = np.linalg.lstsq(cameras.reshape(-1, 3), W.reshape(-1, n_points), rcond=None)[0]
        structure = shape + cameras.transpose(0, 2, 1) @ (W - cameras @ shape)
        samples = W.reshape(-1, n_points).T
        labels = KMeans(n_bodies, n_init=self.restarts, random_state=self.seed).fit_predict(samples)
        return Reconstruction(labels=labels.astype(np.int64), structure=data.scale * structure, cameras=cameras)
