"""Composition of scenes: bodies beside each other before one orbiting camera, or one body before its own cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nrsfm.datasets.body import Array, Body, centre, observed, spread, upright
from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.errors import DatasetError, check_whole, is_number
from nrsfm.datasets.scene import Scene

PLACEMENTS = {"paper": (0.0, 4.0, 0.0), "intersecting": (0.0, 0.0, 0.0)}
SCALES = ("sequence", "cut", "stored")


def offset(placement: str | Sequence[float]) -> Array:
    """Step from each body to the next, (3,): ``paper`` [0, 4, 0], ``intersecting`` zero, or three numbers."""
    if isinstance(placement, str):
        if placement not in PLACEMENTS:
            names = ", ".join(PLACEMENTS)
            raise DatasetError(f"dataset.placement is {placement!r}, wanted one of {names}, or three numbers [x,y,z]")
        return np.array(PLACEMENTS[placement])
    step = np.asarray(placement, dtype=float)
    if step.shape != (3,) or not np.isfinite(step).all():
        raise DatasetError(f"dataset.placement is {list(placement)}, wanted three finite numbers [x,y,z]")
    return step


def view(body: Body, name: str | None = None) -> Scene:
    """A scene of one body before its own cameras, in the source's axes and units; centred per frame.

    The scene has W = R S exactly, and the body's name by default. Raises DatasetError if the body has no cameras, or
    they are not orthonormal.
    """
    if body.cameras is None:
        raise DatasetError(f"body {body.name} has no cameras of its own; place it in a scene instead")
    structure = centre(body.structure)
    return Scene(
        name=name or body.name,
        tracks=project(body.cameras, structure),
        bodies=(body.name,),
        labels=np.zeros(body.n_points, dtype=np.int64),
        structure=structure,
        cameras=body.cameras,
        edges=body.edges,
        digest=body.digest,
        stand_in=body.stand_in,
    )


def placement_of(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of :func:`compose` from the settings of a dataset."""
    return {
        "name": settings["name"],
        "placement": settings["placement"],
        "turn_upright": settings["upright"],
        "scale": settings["scale"],
        "degrees_per_frame": settings["degrees_per_frame"],
    }


def compose(
    bodies: Sequence[Body],
    *,
    name: str | None = None,
    placement: str | Sequence[float] = "paper",
    turn_upright: bool | Sequence[str] = False,
    scale: str = "sequence",
    n_frames: int | None = None,
    degrees_per_frame: float = 5.0,
) -> Scene:
    """Place bodies beside each other and view them with one orbiting camera.

    Each body is centred per frame and scaled to unit spread, and all are cut to the shortest; body k is moved by k
    times the placement's step; the scene is centred per frame and scaled to unit spread. Spread is the mean over frames
    and axes of the standard deviation over points.

    Parameters
    ----------
    bodies : sequence of Body
        One or more.
    name : str, optional
        Scene name; the bodies' names joined by ``_`` by default.
    placement : {"paper", "intersecting"} or three numbers
        Step from each body to the next, in units of one body's spread.
    turn_upright : bool or names of bodies
        Turn every body, or those, so that its vertical is z, the axis the camera circles.
    scale : {"sequence", "cut", "stored"}
        Scale each body to unit spread over its whole sequence, or over the frames that are kept; ``stored`` keeps the
        sources' units.
    n_frames : int, optional
        Keep the first frames alone.
    degrees_per_frame : float
        The camera's step.

    Returns
    -------
    Scene
        With W = R S exactly.

    Raises
    ------
    DatasetError
        If there is no body, the placement is unknown, a body to be turned is not in the scene, or there are fewer
        frames than ``n_frames``.
    """
    if not bodies:
        raise DatasetError("dataset.bodies is empty, wanted at least one body")
    turned = _turned(turn_upright, [body.name for body in bodies])
    if scale not in SCALES:
        raise DatasetError(f"dataset.scale is {scale!r}, wanted one of {', '.join(SCALES)}")
    if not is_number(degrees_per_frame):
        raise DatasetError(f"dataset.degrees_per_frame is {degrees_per_frame!r}, wanted a number")
    step = offset(placement)
    shortest = min(b.n_frames for b in bodies)
    if n_frames is not None:
        check_whole("dataset.frames", n_frames, 2, shortest, " for these bodies")
    parts = []
    for k, body in enumerate(bodies):
        S = centre(upright(body.structure, body.vertical) if body.name in turned else body.structure)
        kept = S[: n_frames or shortest]
        size = spread(kept if scale == "cut" else S)
        if size == 0:
            raise DatasetError(f"body {body.name}: all points coincide, so it cannot be scaled")
        parts.append((kept if scale == "stored" else kept / size) + k * step[:, None])
    return _film(bodies, parts, name, degrees_per_frame)


def captured(
    bodies: Sequence[Body], *, name: str | None = None, turn_upright: bool = True, degrees_per_frame: float = 5.0
) -> Scene:
    """Bodies where they were captured, in the axes of one room, viewed with one orbiting camera.

    The bodies have one length; points that were not captured are gaps in the tracks. ``turn_upright`` turns the room so
    that its vertical is z, the axis the camera circles. The scene is centred per frame and scaled to unit spread, with
    W = R S exactly; its name is by default the bodies' names joined by ``_``. Raises DatasetError if there is no body,
    the bodies differ in length or nothing was captured in some frame.
    """
    if not bodies:
        raise DatasetError("the take holds no body")
    if len({b.n_frames for b in bodies}) > 1:
        raise DatasetError(f"the bodies have {', '.join(str(b.n_frames) for b in bodies)} frames, wanted one number")
    parts = [upright(b.structure, b.vertical) if turn_upright else b.structure for b in bodies]
    return _film(bodies, parts, name, degrees_per_frame)


def _film(bodies: Sequence[Body], parts: Sequence[Array], name: str | None, degrees_per_frame: float) -> Scene:
    """The scene of bodies, with their points (F, 3, P) where they stand, before the orbiting camera."""
    structure = np.concatenate(parts, axis=2)
    title = name or "_".join(b.name for b in bodies)
    visible = observed(structure)
    if empty := np.flatnonzero(~visible.any(axis=1)).tolist():
        raise DatasetError(f"scene {title}: nothing is seen in frame {empty[0]}; leave such frames out")
    structure = centre(structure)
    structure /= spread(structure)
    cameras = orbit(len(structure), degrees_per_frame)
    starts = np.cumsum([0, *(b.n_points for b in bodies)])
    return Scene(
        name=title,
        tracks=project(cameras, structure),
        bodies=tuple(b.name for b in bodies),
        labels=np.repeat(np.arange(len(bodies)), [b.n_points for b in bodies]),
        structure=structure,
        cameras=cameras,
        visible=None if visible.all() else visible,
        edges=np.concatenate([body.edges + start for body, start in zip(bodies, starts[:-1], strict=True)]),
        digest=" ".join(b.digest for b in bodies),
        stand_in=any(b.stand_in for b in bodies),
    )


def _turned(setting: bool | Sequence[str], names: Sequence[str]) -> Sequence[str]:
    """The names of the bodies that are turned upright."""
    if isinstance(setting, bool):
        return names if setting else ()
    if isinstance(setting, str) or not isinstance(setting, Sequence) or not set(setting) <= set(names):
        raise DatasetError(f"dataset.upright is {setting!r}, wanted true, false, or some of {list(names)}")
    return setting
