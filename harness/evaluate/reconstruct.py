"""One method on one scene: what a trial and a user's own tracks have in common."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.memory import Size, refusal
from nrsfm.harness.record.errors import UsageError
from nrsfm.methods.base import NO_CAMERAS, Array, Method, MethodError, Progress, Reconstruction, stage
from nrsfm.methods.gaps import complete
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
    """What a method finds in a scene.

    Parameters
    ----------
    scene : Scene
    method : Method
    n_bodies : int or None
        None leaves it to the method.
    cameras : mapping
        ``source``, ``known`` or ``estimated``; for the latter ``rank``, ``start`` and ``refine`` as
        :func:`nrsfm.methods.structure.rotation.estimate_cameras` takes them.
    memory_gb : float
        What would need more is not begun.
    progress : callable, optional
        Told of the stages and of the method's iterations.

    Raises
    ------
    MethodError
        If the method cannot do what is asked, or does not keep its word.
    UsageError
        If there are no cameras, or the method would need more memory than it may take.
    """
    if why := refusal(method, Size.of(scene), memory_gb):
        raise UsageError(why)
    R = NO_CAMERAS
    if method.uses_cameras:
        if cameras["source"] != "known":
            stage(progress, "cameras")
        R = _cameras(scene, cameras)
    stage(progress, "method")
    gaps = _gaps(method, scene)
    found = method.reconstruct(scene.tracks, R, n_bodies, edges=scene.edges, progress=progress, **gaps)
    check(found, method.provides, scene.tracks.shape)
    return found


def _gaps(method: Method, scene: Scene) -> Mapping[str, Any]:
    """What a method is told of gaps: nothing where there are none, so that it need not know the word."""
    if scene.visible is None:
        return {}
    if "visible" not in inspect.signature(method.reconstruct).parameters:
        raise MethodError(f"{type(method).__name__} cannot work with gaps: its reconstruct takes no 'visible'")
    return {"visible": scene.visible}


def _cameras(scene: Scene, settings: Mapping[str, Any]) -> Array:
    if settings["source"] != "known":
        options = {name: settings[name] for name in ("rank", "start", "refine") if name in settings}
        return estimate_cameras(complete(scene.tracks, scene.visible), **options)
    if scene.cameras is None:
        raise UsageError(f"scene {scene.name} has no cameras; use cameras=estimated")
    return scene.cameras


def check(found: Reconstruction, provides: frozenset[str], shape: tuple[int, ...]) -> None:
    """Hold a method to its word: raises MethodError on parts that are absent, misshapen or not finite."""
    n_frames, _, n_points = shape
    wanted = {"structure": (n_frames, 3, n_points), "labels": (n_points,), "affinity": (n_points, n_points)}
    for name, size in wanted.items():
        value = getattr(found, name)
        if value is None:
            if name in provides:
                raise MethodError(f"the method promises {name} and gave none")
        elif value.shape != size:
            raise MethodError(f"the method gave {name} of shape {value.shape}, wanted {size}")
        elif not np.isfinite(value.data if sp.issparse(value) else value).all():
            raise MethodError(f"the method gave {name} with NaN or infinite values: it diverged")
