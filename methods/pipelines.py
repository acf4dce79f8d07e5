"""Clustering in 2D, and the pipelines of reconstruction and clustering.

Each is composed of a clusterer (SSC, SSC-OMP, EDSC, LRR: scikit-learn estimators on tracks as samples) and, but for the
first, a reconstructor (BMM, PTA).
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace

import numpy as np
import scipy.linalg
from sklearn.base import BaseEstimator, clone

from nrsfm.methods import base
from nrsfm.methods.base import Array, Labels, Method, MethodError, Observations, Reconstruction
from nrsfm.methods.clustering.clusterer import Code
from nrsfm.methods.gaps import complete, enough
from nrsfm.methods.structure.pta import trajectory_basis


@dataclass(eq=False, repr=False)
class ClusterTracks(Method):
    """Labels from the 2D tracks alone: SSC(2D), EDSC(2D).

    Parameters
    ----------
    clusterer : estimator
        With ``n_clusters``, ``fit``, ``labels_`` and ``affinity_matrix_``.
    standardise : bool
        Centre the tracks and scale them to unit spread first. False takes them as they are, as the authors of SSC and
        EDSC do: the weights of both depend on the origin, and that of EDSC on the unit too.
    projection : int, optional
        Project each track onto the first ``projection * n_bodies`` principal directions; None keeps all.
    """

    provides = frozenset({"labels"})
    uses_cameras = False
    handles_gaps = True

    clusterer: BaseEstimator
    _: KW_ONLY
    standardise: bool = True
    projection: int | None = None

    def reconstruct(self, observations: Observations, n_bodies: int | None) -> Reconstruction:
        """See :meth:`nrsfm.methods.base.Method.reconstruct`; gaps are filled in first."""
        base.check_bodies(n_bodies, observations.tracks.shape[2])
        tracks = _complete(observations)
        W = base.standardise(tracks).W if self.standardise else tracks
        if self.projection is not None:
            if n_bodies is None:
                raise MethodError("a projection to so many dimensions a body needs the number of bodies; set n_bodies")
            W = principal(W, self.projection * n_bodies)
        observations.stage("clustering")
        labels, affinity = cluster(self.clusterer, W, n_bodies)
        return Reconstruction(labels=labels, affinity=affinity)

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """See :meth:`nrsfm.methods.base.Method.memory`."""
        return clusterer_bytes(self.clusterer, n_points, 2 * n_frames)


class _Pipeline(Method):
    """A method that is made of a reconstructor and a clusterer."""

    provides = frozenset({"labels", "structure"})
    handles_gaps = True

    reconstructor: Method
    clusterer: BaseEstimator

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        """Bytes of the reconstructor, as far as known, and the clusterer."""
        structure = self.reconstructor.memory(n_frames, n_points) or 0.0
        return structure + clusterer_bytes(self.clusterer, n_points, 3 * n_frames)


@dataclass(eq=False, repr=False)
class ReconstructThenCluster(_Pipeline):
    """BMM+SSC(3D): reconstruct all tracks as one body, then cluster the 3D trajectories.

    Parameters
    ----------
    reconstructor : Method
    clusterer : estimator

    References
    ----------
    Kumar, Dai, Li, 3DV 2016, section 4, baseline method 1.
    """

    reconstructor: Method
    clusterer: BaseEstimator

    def reconstruct(self, observations: Observations, n_bodies: int | None) -> Reconstruction:
        """See :meth:`nrsfm.methods.base.Method.reconstruct`."""
        base.check_bodies(n_bodies, observations.tracks.shape[2])
        structure = _structure(self.reconstructor, observations)
        observations.stage("clustering")
        labels, affinity = cluster(self.clusterer, structure, n_bodies)
        return Reconstruction(labels=labels, structure=structure, cameras=observations.cameras, affinity=affinity)


@dataclass(eq=False, repr=False)
class ClusterThenReconstruct(_Pipeline):
    """SSC(2D)+BMM: cluster the tracks, then reconstruct each cluster.

    A cluster's reconstruction is centred, so its centroid is lifted separately: the 3D centroid trajectory is the
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

    clusterer: BaseEstimator
    reconstructor: Method
    trajectory_order: int = 3

    def reconstruct(self, observations: Observations, n_bodies: int | None) -> Reconstruction:
        """See :meth:`nrsfm.methods.base.Method.reconstruct`; gaps are filled in for clusters and centroids alone."""
        cameras, visible = observations.required_cameras(), observations.visible
        base.check_bodies(n_bodies, observations.tracks.shape[2])
        data = base.standardise(_complete(observations))
        observations.stage("clustering")
        labels, affinity = cluster(self.clusterer, data.W, n_bodies)
        structure = np.empty((len(data.W), 3, len(labels)))
        for label in np.unique(labels):
            members = labels == label
            W = data.W[:, :, members]
            centroid = lift(W.mean(axis=2), cameras, self.trajectory_order)
            structure[:, :, members] = centroid[:, :, None]
            if members.sum() > 1 and np.ptp(W, axis=2).max() > 0:  # else all its points are at the centroid
                seen = None if visible is None else enough(visible[:, members])
                part = replace(observations, tracks=W, visible=seen, edges=None)
                structure[:, :, members] += _structure(self.reconstructor, part)
        structure -= structure.mean(axis=2, keepdims=True)
        return Reconstruction(labels=labels, structure=structure * data.scale, cameras=cameras, affinity=affinity)


def cluster(clusterer: BaseEstimator, trajectories: Array, n_bodies: int | None) -> tuple[Labels, Code]:
    """Labels and affinity of (F, k, P) trajectories; each track is one sample of kF features.

    The columns of W or S lie on a union of affine subspaces, S = S C and 1'C = 1': Kumar, Dai, Li, 3DV 2016, eq. (4).
    Where ``n_bodies`` is None the clusterer estimates it.
    """
    samples = trajectories.reshape(-1, trajectories.shape[-1]).T
    try:
        fitted = clone(clusterer).set_params(n_clusters=n_bodies).fit(samples)
    except MethodError:
        raise
    except ValueError as error:  # of scikit-learn's checks
        raise MethodError(f"{type(clusterer).__name__}: {error}") from error
    return fitted.labels_, fitted.affinity_matrix_


def clusterer_bytes(clusterer: BaseEstimator, n_points: int, n_features: int) -> float:
    """Peak memory of a clusterer in bytes: its own forecast, or the eleven P x P arrays that SSC and EDSC take."""
    forecast = getattr(clusterer, "memory", None)
    return float(forecast(n_points, n_features)) if forecast else 8.0 * 11 * n_points**2


def principal(trajectories: Array, dimension: int) -> Array:
    """Coordinates of (F, k, P) trajectories along their first principal directions, not centred.

    They are (dimension, P), or fewer rows where the trajectories have fewer dimensions. Raises MethodError if the
    dimension is not positive.

    References
    ----------
    Elhamifar, Vidal, "Sparse subspace clustering", PAMI 2013, motion segmentation: the projection to 4n dimensions.
    """
    if not isinstance(dimension, int) or dimension < 1:
        raise MethodError(f"projection to {dimension} dimensions, wanted a whole number of at least 1")
    X = trajectories.reshape(-1, trajectories.shape[-1])
    _, s, Vt = scipy.linalg.svd(X, full_matrices=False, check_finite=False)
    coordinates: Array = s[:dimension, None] * Vt[:dimension]
    return coordinates


def lift(centroid: Array, cameras: Array, order: int) -> Array:
    """(F, 3) trajectory on the first ``order`` DCT vectors whose projection is nearest to an (F, 2) track.

    Raises MethodError if the order is not in 1..F.

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
    trajectory: Array = basis @ weights.reshape(3, order).T
    return trajectory


def _complete(observations: Observations) -> Array:
    """The tracks with their gaps filled in without cameras."""
    if observations.visible is not None:
        observations.stage("gaps")
    return complete(observations.tracks, observations.visible)


def _structure(reconstructor: Method, observations: Observations) -> Array:
    """The structure of the tracks as one body."""
    base.check_gap_handling(reconstructor, observations.visible)
    structure = reconstructor.reconstruct(observations, 1).structure
    if structure is None:
        raise MethodError(f"{type(reconstructor).__name__} gives no structure, so it cannot be a reconstructor")
    return structure
