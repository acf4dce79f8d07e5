"""Run one method on one scene, for trials and for a user's own tracks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy.sparse as sp

from nrsfm.datasets.body import centre
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.memory import Size, refusal
from nrsfm.harness.record.errors import UsageError
from nrsfm.methods import base
from nrsfm.methods.base import Array, Cleaned, Method, MethodError, Observations, Progress, Reconstruction, stage
from nrsfm.methods.gaps import complete
from nrsfm.methods.observed.cleaning import at_one_scale, without_outliers
from nrsfm.methods.structure.refinement import refine_cameras
from nrsfm.methods.structure.rotation import estimate_cameras

#: Times by which a structure may be wider than the tracks.
WIDEST = 100.0
#: Observations as they are.
AS_GIVEN: Mapping[str, bool] = MappingProxyType({"robust": False, "scale": False})


def reconstruct(
    scene: Scene,
    method: Method,
    n_bodies: int | None,
    cameras: Mapping[str, Any],
    observations: Mapping[str, bool] = AS_GIVEN,
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
    observations : mapping
        ``robust``: whether outliers become missing observations. ``scale``: whether each frame's scale is taken out of
        the tracks, for which cameras are needed, whatever the method. See
        :class:`nrsfm.methods.base.Cleaned`.
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
    cleaned = Cleaned(scene.tracks, scene.visible)
    if observations["robust"]:
        stage(progress, "outliers")
        cleaned = without_outliers(cleaned)
    whole = cache(lambda: complete(cleaned.tracks, cleaned.visible))
    R = None
    if method.uses_cameras or observations["scale"]:
        R = scene.cameras
        if cameras["source"] != "known":
            stage(progress, "cameras")
            R = estimate_cameras(whole(), **_named(cameras, "rank", "start", "refine"))
        elif R is None:
            raise UsageError(f"scene {scene.name} has no cameras; use cameras=estimated")
    given = cleaned
    if observations["scale"] and R is not None:
        stage(progress, "scale")
        given = at_one_scale(cleaned, whole(), R)
    if method.uses_cameras and R is not None and cameras["source"] == "refined":
        stage(progress, "cameras and structure")
        images = whole() if given.scales is None else whole() / given.scales[:, None, None]
        R = refine_cameras(images, R, **_named(cameras, "turning", "smoothing", "noise", "iterations")).cameras
    stage(progress, "method")
    tracks, visible = given.tracks, given.visible
    if visible is not None and not method.handles_gaps:
        tracks, visible = complete(tracks, visible), None
    R = R if method.uses_cameras else None
    found = method.reconstruct(Observations(tracks, R, visible, scene.edges, progress), n_bodies)
    check(found, method.provides, scene.tracks)
    return replace(found, cleaned=given) if any(observations.values()) else found


def _named(settings: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {name: settings[name] for name in names if name in settings}


def check(reconstruction: Reconstruction, provides: frozenset[str], tracks: Array) -> None:
    """Raise MethodError on parts of a result that are promised and absent, of wrong shape, not finite, or out of scale.

    A structure is out of scale where it is more than :data:`WIDEST` times as wide as the (F, 2, P) tracks.
    """
    n_frames, _, n_points = tracks.shape
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
    if reconstruction.structure is not None:
        reach = np.abs(centre(reconstruction.structure)).max(axis=(0, 1))
        times = float(reach.max() / np.nanmax(np.abs(centre(tracks))))
        if times > WIDEST:
            raise MethodError(
                f"the structure is {times:.2g} times as wide as the tracks, track {reach.argmax()} most of all, which "
                "the images do not determine; leave that track out, or take another method"
            )
