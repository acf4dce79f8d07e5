"""Run one method on one scene, for trials and for a user's own tracks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.memory import Size, refusal
from nrsfm.harness.record.errors import UsageError
from nrsfm.methods import base
from nrsfm.methods.base import Method, MethodError, Observations, Progress, Reconstruction, stage
from nrsfm.methods.gaps import complete
from nrsfm.methods.structure.refinement import refine_cameras
from nrsfm.methods.structure.rotation import estimate_cameras


def reconstruct(
    scene: Scene,
    method: Method,
    n_bodies: int | None,
    cameras: Mapping[str, Any],
    *,
    memory_gb: float = float("inf"),
    progress: Progress | None = None,
) -> Reconstruction:
    """The reconstruction of a scene by a method.

    Parameters
    ----------
    n_bodies : int or None
        None lets the method estimate it.
    cameras : mapping
        ``source``, ``known``, ``estimated`` or ``refined``; for the latter two ``rank``, ``start`` and ``refine`` as
        :func:`nrsfm.methods.structure.rotation.estimate_cameras` takes them, for the last also ``turning``,
        ``smoothing``, ``noise`` and ``iterations`` of :func:`nrsfm.methods.structure.refinement.refine_cameras`.
    memory_gb : float
        A method that is forecast to need more is not started.
    progress : callable, optional
        Called for stages and for the method's iterations.

    Raises
    ------
    MethodError
        If the method cannot work with the scene, or its result is not what it promises.
    UsageError
        If there are no cameras, or the method would need more memory than allowed.
    """
    if reason := refusal(method, Size.of(scene), memory_gb):
        raise UsageError(reason)
    base.check_gap_handling(method, scene.visible)
    R = None
    if method.uses_cameras and cameras["source"] == "known":
        R = scene.cameras
        if R is None:
            raise UsageError(f"scene {scene.name} has no cameras; use cameras=estimated")
    elif method.uses_cameras:
        stage(progress, "cameras")
        tracks = complete(scene.tracks, scene.visible)
        R = estimate_cameras(tracks, **_named(cameras, "rank", "start", "refine"))
        if cameras["source"] == "refined":
            stage(progress, "cameras and structure")
            R = refine_cameras(tracks, R, **_named(cameras, "turning", "smoothing", "noise", "iterations")).cameras
    stage(progress, "method")
    observations = Observations(scene.tracks, R, scene.visible, scene.edges, progress)
    reconstruction = method.reconstruct(observations, n_bodies)
    check(reconstruction, method.provides, scene.tracks.shape)
    return reconstruction


def _named(settings: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {name: settings[name] for name in names if name in settings}


def check(reconstruction: Reconstruction, provides: frozenset[str], shape: tuple[int, ...]) -> None:
    """Raise MethodError on parts of a result that are promised and absent, or of wrong shape, or not finite."""
    n_frames, _, n_points = shape
    wanted = {"structure": (n_frames, 3, n_points), "labels": (n_points,), "affinity": (n_points, n_points)}
    for name, size in wanted.items():
        value = getattr(reconstruction, name)
        if value is None:
            if name in provides:
                raise MethodError(f"the method promises {name} and gave none")
        elif value.shape != size:
            raise MethodError(f"the method gave {name} of shape {value.shape}, wanted {size}")
        elif not np.isfinite(value.data if sp.issparse(value) else value).all():
            raise MethodError(f"the method gave {name} with NaN or infinite values: it diverged")
