"""Clustering in 2D, and the two-stage pipelines of reconstruction and clustering.

Each is composed of a clusterer (SSC, SSC-OMP, EDSC, LRR: scikit-learn estimators on tracks as samples) and a
reconstructor (BMM, PTA).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone

from nrsfm.methods.base import (
    Array,
    Labels,
    Mask,
    Method,
    MethodError,
    Progress,
    Reconstruction,
    check_bodies,
    check_cameras,
    check_shape,
    check_tracks,
    stage,
    standardise,
)
from nrsfm.methods.gaps import complete, enough
from nrsfm.methods.structure.pta import trajectory_basis


class ClusterTracks(Method):
    """Labels from the 2D tracks alone: SSC(2D), EDSC(2D).

    Parameters
    ----------
    clusterer : estimator
        With ``n_clusters``, ``fit``, ``labels_`` and ``affinity_matrix_``.
    standardise : bool
        Centre the tracks and scale them to unit spread first. Off takes them as they are, as the authors of SSC and
        EDSC do: the weights of both depend on where the origin is, and that of EDSC on the unit too.
    projection : int, optional
        Project each track onto the first ``projection * n_bodies`` principal directions; None keeps all.
    """

    provides = frozenset({"labels"})
    uses_cameras = False

    def __init__(self, clusterer: BaseEstimator, *, standardise: bool = True, projection: int | None = None) -> None:
        self.clusterer = clusterer
        self.standardise = standardise
        self.projection = projection

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
        """See :meth:`nrsfm.methods.base.Method.reconstruct`; the cameras play no part, and gaps are filled in first."""
        stage(progress, "clustering" if visible is None else "gaps")
        tracks = complete(tracks, visible)
        check_tracks(tracks)
        check_bodies(n_bodies, tracks.shape[2])
        W = standardise(tracks).W if self.standardise else tracks
        if self.projection is not None:
            if n_bodies is None:
                raise MethodError("a projection to so many dimensions a body needs the number of bodies; set n_bodies")
            W = principal(W, self.projection * n_bodies)
        stage(progress, "clustering")
        labels, affinity = cluster(self.clusterer, W, n_bodies)
        return Reconstruction(labels=labels, affinity=affinity)

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """See :meth:`nrsfm.methods.base.Method.memory`."""
        return clusterer_bytes(self.clusterer, n_points, 2 * n_frames)


class ReconstructThenCluster(Method):
    """BMM+SSC(3D): reconstruct all tracks as one body, then cluster the 3D trajectories.

    Parameters
    ----------
    reconstructor : Method
    clusterer : estimator

    References
    ----------
    Kumar, Dai, Li, 3DV 2016, section 4, baseline method 1.
    """

    provides = frozenset({"labels", "structure"})

    def __init__(self, reconstructor: Method, clusterer: BaseEstimator) -> None:
        self.reconstructor = reconstructor
        self.clusterer = clusterer

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
        """See :meth:`nrsfm.methods.base.Method.reconstruct`; the structure has no gaps left to cluster."""
        check_shape(tracks)
        check_bodies(n_bodies, tracks.shape[2])
        structure = _structure(self.reconstructor, tracks, cameras, visible, progress)
        stage(progress, "clustering")
        labels, affinity = cluster(self.clusterer, structure, n_bodies)
        return Reconstruction(labels=labels, structure=structure, cameras=cameras, affinity=affinity)

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """See :meth:`nrsfm.methods.base.Method.memory`."""
        structure = self.reconstructor.memory(n_frames, n_points) or 0.0
        return structure + clusterer_bytes(self.clusterer, n_points, 3 * n_frames)


class ClusterThenReconstruct(Method):
    """SSC(2D)+BMM: cluster the tracks, then reconstruct each cluster.

    A cluster's reconstruction is centred, so its centroid is lifted apart: the 3D centroid trajectory is the
    least-squares fit of the 2D centroid track on a low-order DCT basis, exact for a constant offset between bodies.

    Parameters
    ----------
    clusterer : estimator
    reconstructor : Method
    trajectory_order : int
        Number of DCT vectors of a centroid's trajectory. It must stay well below the frequency at which the camera
        circles the scene, or a moving body cannot be told from a moving camera.

    References
    ----------
    Kumar, Dai, Li, 3DV 2016, section 4, baseline method 2.
    """

    provides = frozenset({"labels", "structure"})

    def __init__(self, clusterer: BaseEstimator, reconstructor: Method, trajectory_order: int = 3) -> None:
        self.clusterer = clusterer
        self.reconstructor = reconstructor
        self.trajectory_order = trajectory_order

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
        """See :meth:`nrsfm.methods.base.Method.reconstruct`; gaps are filled in for clusters and centroids alone."""
        check_cameras(cameras, len(tracks))
        stage(progress, "clustering" if visible is None else "gaps")
        data = standardise(complete(tracks, visible))
        stage(progress, "clustering")
        labels, affinity = cluster(self.clusterer, data.W, n_bodies)
        structure = np.empty((tracks.shape[0], 3, tracks.shape[2]))
        for label in np.unique(labels):
            mine = labels == label
            W = data.W[:, :, mine]
            centroid = lift(W.mean(axis=2), cameras, self.trajectory_order)
            structure[:, :, mine] = centroid[:, :, None]
            if mine.sum() > 1 and np.ptp(W, axis=2).max() > 0:  # one point, or one place, is its centroid alone
                seen = None if visible is None else enough(visible[:, mine])
                structure[:, :, mine] += _structure(self.reconstructor, W, cameras, seen, progress)
        structure -= structure.mean(axis=2, keepdims=True)
        return Reconstruction(labels=labels, structure=structure * data.scale, cameras=cameras, affinity=affinity)

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """See :meth:`nrsfm.methods.base.Method.memory`."""
        structure = self.reconstructor.memory(n_frames, n_points) or 0.0
        return structure + clusterer_bytes(self.clusterer, n_points, 3 * n_frames)


def cluster(clusterer: BaseEstimator, trajectories: Array, n_bodies: int | None) -> tuple[Labels, Array | sp.sparray]:
    """Labels and affinity of (F, k, P) trajectories; each track is one sample of kF features.

    The columns of W or S on a union of affine subspaces, S = S C and 1'C = 1': Kumar, Dai, Li, 3DV 2016, eq. (4). The
    clusterer estimates a number of bodies that is None.
    """
    n_points = trajectories.shape[-1]
    check_bodies(n_bodies, n_points)
    samples = trajectories.reshape(-1, n_points).T
    try:
        fitted = clone(clusterer).set_params(n_clusters=n_bodies).fit(samples)
    except ValueError as error:
        raise MethodError(f"{type(clusterer).__name__}: {error}") from error
    return fitted.labels_, fitted.affinity_matrix_


def clusterer_bytes(clusterer: BaseEstimator, n_points: int, n_features: int) -> float:
    """Bytes that a clusterer takes at its peak: what it foresees itself, or the eleven P x P arrays of SSC and EDSC, as
    measured.
    """
    own = getattr(clusterer, "memory", None)
    return own(n_points, n_features) if own else 8.0 * 11 * n_points**2


def principal(trajectories: Array, dimension: int) -> Array:
    """Coordinates of (F, k, P) trajectories along their first principal directions, not centred.

    Returns
    -------
    (dimension, P) array
        Fewer rows where the trajectories have fewer dimensions.

    Raises
    ------
    MethodError
        If the dimension is not positive.

    References
    ----------
    Elhamifar, Vidal, "Sparse subspace clustering", PAMI 2013, motion segmentation: the projection to 4n dimensions.
    """
    if not isinstance(dimension, int) or dimension < 1:
        raise MethodError(f"projection to {dimension} dimensions, wanted a whole number of at least 1")
    X = trajectories.reshape(-1, trajectories.shape[-1])
    _, s, Vt = scipy.linalg.svd(X, full_matrices=False, check_finite=False)
    return s[:dimension, None] * Vt[:dimension]


def lift(centroid: Array, cameras: Array, order: int) -> Array:
    """3D trajectory on the first ``order`` DCT vectors whose projection is nearest to an (F, 2) track.

    Returns
    -------
    (F, 3) array

    Raises
    ------
    MethodError
        If the order is not in 1..F.

    References
    ----------
    Akhter, Sheikh, Khan, Kanade, "Trajectory space", PAMI 2011: a point's trajectory is Theta a, Theta the DCT basis.
    """
    F = len(centroid)
    if not 1 <= order <= F:
        raise MethodError(f"trajectory_order is {order}, wanted 1..{F}")
    basis = trajectory_basis(F, order)
    system = np.einsum("fij,fk->fijk", cameras, basis).reshape(2 * F, 3 * order)
    weights = np.linalg.lstsq(system, centroid.reshape(2 * F), rcond=None)[0]
    return basis @ weights.reshape(3, order).T


def _structure(
    reconstructor: Method, tracks: Array, cameras: Array, visible: Mask | None, progress: Progress | None
) -> Array:
    structure = reconstructor.reconstruct(tracks, cameras, 1, visible=visible, progress=progress).structure
    if structure is None:
        raise MethodError(f"{type(reconstructor).__name__} gives no structure, so it cannot be a reconstructor")
    return structure
