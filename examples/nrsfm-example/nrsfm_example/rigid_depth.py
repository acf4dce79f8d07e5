"""RigidDepth: one rigid shape for all frames, and k-means of the tracks.

An example to start from. It takes arrays and gives a Reconstruction, and knows nothing of files or experiments.
"""

from __future__ import annotations

import numpy as np
from sklearn.cluster import KMeans

from nrsfm.methods.base import Method, MethodError, Observations, Reconstruction, check_bodies, check_count, standardise
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

    provides = frozenset({"labels", "structure"})  # the parts that it computes; one of them is enough
    handles_gaps = True  # it reads observations.visible; leave this out and tracks with gaps are refused
    version = "1"  # raise it whenever results change, so that finished trials are run again

    def __init__(self, *, restarts: int = 20, seed: int = 0) -> None:
        self.restarts = restarts  # stored as it is and nothing else; the configuration sets it by this name
        self.seed = seed

    def reconstruct(self, observations: Observations, n_bodies: int | None) -> Reconstruction:
        """(F, 2, P) tracks and (F, 2, 3) cameras in; labels (P,) and structure (F, 3, P) out.

        W = R_f s for all frames f gives the rigid shape s by least squares. S_f = s + R_f' (w_f - R_f s) then meets
        every image exactly, and has the depths of s.
        """
        check_count(self, "restarts")
        check_bodies(n_bodies, observations.tracks.shape[2])
        if n_bodies is None:
            raise MethodError("RigidDepth cannot estimate the number of bodies; set n_bodies")
        cameras = observations.required_cameras()
        data = standardise(complete(observations.tracks, observations.visible))  # centred, of unit spread
        W, n_points = data.W, data.W.shape[2]
        shape = np.linalg.lstsq(cameras.reshape(-1, 3), W.reshape(-1, n_points), rcond=None)[0]
        structure = shape + cameras.transpose(0, 2, 1) @ (W - cameras @ shape)
        samples = W.reshape(-1, n_points).T
        labels = KMeans(n_bodies, n_init=self.restarts, random_state=self.seed).fit_predict(samples)
        return Reconstruction(labels=labels.astype(np.int64), structure=data.scale * structure, cameras=cameras)
