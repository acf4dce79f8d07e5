"""Scenes: bodies placed beside each other before one orthographic camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array, Body, centre, no_edges, observed, spread, upright
from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.errors import DatasetError, check_whole, is_number
from nrsfm.datasets.gaps import drop
from nrsfm.datasets.noise import add_noise

PLACEMENTS = {"paper": (0.0, 4.0, 0.0), "intersecting": (0.0, 0.0, 0.0)}


SCALES = ("sequence", "cut", "stored")


@dataclass(frozen=True)
class Scene:
    """Input of a trial: 2D tracks, and the true structure, cameras and labels where they are known.

    Parameters
    ----------
    name : str
        Short name, part of every seed.
    tracks : (F, 2, P) array
        Image coordinates.
    bodies : tuple of str
        Names of the bodies, in the order of the labels.
    labels : (P,) int array or None
        Index of each track's body.
    structure : (F, 3, P) array or None
        True 3D points, centred per frame; NaN where a point was not captured.
    cameras : (F, 2, 3) array or None
        Orthographic cameras with orthonormal rows.
    visible : (F, P) bool array or None
        False where a track is not observed and its position is NaN; None if all are observed.
    edges : (E, 2) int array
        Bones or surface neighbours.
    digest : str
        Hash of the data files (or of the generator's settings) behind the scene.
    stand_in : bool
        Whether generated bodies take the place of real sequences that were not found.
    track_ids, frame_ids : tuple of str
        Names of the source for its tracks and frames; empty if it has none.
    notes : tuple of str
        Changes to the source's numbers that a reader must know.

    Raises
    ------
    DatasetError
        On shapes that do not fit each other, non-finite observed tracks, or cameras that are not orthonormal.
    """

    name: str
    tracks: Array
    bodies: tuple[str, ...] = ()
    labels: NDArray[np.int64] | None = None
    structure: Array | None = None
    cameras: Array | None = None
    visible: NDArray[np.bool_] | None = None
    edges: NDArray[np.int64] = field(default_factory=no_edges)
    digest: str = ""
    stand_in: bool = False
    track_ids: tuple[str, ...] = ()
    frame_ids: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        W = self.tracks
        if W.ndim != 3 or W.shape[1] != 2 or W.shape[0] < 2 or W.shape[2] < 2:
            raise DatasetError(f"scene {self.name}: tracks have shape {W.shape}, wanted (frames >= 2, 2, points >= 2)")
        n_frames, _, n_points = W.shape
        wanted = {
            "structure": (n_frames, 3, n_points),
            "cameras": (n_frames, 2, 3),
            "labels": (n_points,),
            "visible": (n_frames, n_points),
        }
        for key, shape in wanted.items():
            value = getattr(self, key)
            if value is not None and value.shape != shape:
                raise DatasetError(f"scene {self.name}: {key} has shape {value.shape}, wanted {shape}")
        for key, count in (("track_ids", n_points), ("frame_ids", n_frames)):
            if getattr(self, key) and len(getattr(self, key)) != count:
                raise DatasetError(f"scene {self.name}: {key} holds {len(getattr(self, key))} names, wanted {count}")
        bad = ~observed(W)
        if self.structure is not None:
            bad |= ~observed(self.structure)
        if self.visible is not None:
            bad &= self.visible
            _check_gaps(self.name, W, self.visible)
        if bad.any():
            frame, point = np.argwhere(bad)[0]
            raise DatasetError(
                f"scene {self.name}: {int(bad.sum())} track positions are NaN or infinite (first: frame {frame}, "
                f"point {point}); remove those tracks or mark them as not visible"
            )
        if self.cameras is not None:
            off = np.abs(self.cameras @ self.cameras.transpose(0, 2, 1) - np.eye(2)).max()
            if not off < 1e-6:
                raise DatasetError(f"scene {self.name}: camera rows are not orthonormal (off by {off:.2g})")

    @property
    def n_frames(self) -> int:
        return len(self.tracks)

    @property
    def n_points(self) -> int:
        return int(self.tracks.shape[2])

    @property
    def n_bodies(self) -> int | None:
        """Number of bodies, None when there are no labels."""
        return None if self.labels is None else len(np.unique(self.labels))

    def with_noise(self, level: float, repeat: int = 0) -> Scene:
        """A copy with noise on the tracks (see :func:`nrsfm.datasets.noise.add_noise`)."""
        return replace(self, tracks=add_noise(self.tracks, level, repeat, self.name))

    def with_gaps(self, kind: str, share: float, length: int = 1, repeat: int = 0) -> Scene:
        """A copy without a share of the observations (see :func:`nrsfm.datasets.gaps.drop`); the truth stays whole."""
        visible = drop(self.tracks, kind, share, length, repeat, self.name)
        if visible.all():
            return self
        return replace(self, tracks=np.where(visible[:, None], self.tracks, np.nan), visible=visible)


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

    Parameters
    ----------
    body : Body
        With cameras.
    name : str, optional
        Scene name; the body's by default.

    Returns
    -------
    Scene
        With W = R S exactly.

    Raises
    ------
    DatasetError
        If the body has no cameras, or they are not orthonormal.
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

    Parameters
    ----------
    bodies : sequence of Body
        One or more, of one length. Points that were not captured are gaps in the tracks.
    name : str, optional
        Scene name; the bodies' names joined by ``_`` by default.
    turn_upright : bool
        Turn the room so that its vertical is z, the axis the camera circles.
    degrees_per_frame : float
        The camera's step.

    Returns
    -------
    Scene
        Centred per frame and scaled to unit spread, with W = R S exactly.

    Raises
    ------
    DatasetError
        If there is no body, the bodies differ in length or nothing was captured in some frame.
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


def _check_gaps(name: str, W: Array, visible: NDArray[np.bool_]) -> None:
    """Raise DatasetError unless hidden positions are NaN and every frame and every track is seen somewhere."""
    if not np.isnan(W.transpose(0, 2, 1)[~visible]).all():
        raise DatasetError(f"scene {name}: a hidden track position holds a number, wanted NaN")
    for axis, word in ((1, "frame"), (0, "track")):
        unseen = np.flatnonzero(~visible.any(axis=axis))
        if len(unseen):
            raise DatasetError(f"scene {name}: {word} {unseen[0]} is never observed; leave it out")
