"""The eight motion-capture sequences of the non-rigid structure-from-motion literature.

drink, pickup, yoga, stretch, dance: Akhter, Sheikh, Khan, Kanade, "Trajectory Space", PAMI 2011.
face, walking, shark: Torresani, Hertzmann, Bregler, PAMI 2008 (the shark is stored as ``jaws``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array, Body, centre, no_edges, register
from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.public.catalogue import sha256
from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.datasets.scene import Scene, compose, view


@dataclass(frozen=True)
class Recording:
    """Where a sequence's numbers are and how they are laid out.

    ``interleaved`` files hold S (3F, P) with rows x, y, z per frame; ``blocks`` hold P3_gt (3F, P) with F rows
    of x, then of y, then of z. ``registered`` says how the body's own rotation is removed: it ``stored``
    already, by ``procrustes`` analysis, or in a ``cameras`` file that holds the registered shape. ``camera`` is what
    the published reconstructions saw it with: the cameras ``Rs`` of the file, or a fixed one by the two axes of its
    image.
    """

    file: str
    n_frames: int
    n_points: int
    layout: str = "interleaved"
    registered: str = "stored"
    camera: str = "Rs"

    @property
    def vertical(self) -> str:
        return "z" if self.layout == "interleaved" else "y"


SEQUENCES: Mapping[str, Recording] = {
    "drink": Recording("drink.mat", 1102, 41),
    "pickup": Recording("pickup.mat", 357, 41),
    "yoga": Recording("yoga.mat", 307, 41),
    "stretch": Recording("stretch.mat", 370, 41),
    "dance": Recording("dance.mat", 264, 75, registered="procrustes", camera="yz"),
    "face": Recording("face.mat", 316, 40, layout="blocks", registered="procrustes", camera="xy"),
    "walking": Recording("walking.mat", 260, 55, layout="blocks", registered="procrustes", camera="xy"),
    "shark": Recording("jaws.mat", 240, 91, layout="blocks", registered="cameras", camera="xy"),
}


SHARK_CAMERAS = "jaws_cameras.mat"


MOTIONS = ("registered", "native")


def recording(name: str) -> Recording:
    """Look a sequence up by name; raises DatasetError that lists the names."""
    if name not in SEQUENCES:
        raise DatasetError(f"dataset.bodies names {name!r}, which is none of {', '.join(SEQUENCES)}")
    return SEQUENCES[name]


def files(name: str, motion: str = "registered") -> list[str]:
    """The files, relative to the data folder, that :func:`load_body` reads."""
    source = recording(name)
    registered_apart = motion == "registered" and source.registered == "cameras"
    return [f"mocap/{SHARK_CAMERAS if registered_apart else source.file}"]


def load_body(folder: Path, name: str, motion: str = "registered") -> Body:
    """Read one sequence.

    Parameters
    ----------
    folder : Path
        The data folder, which holds ``mocap/``.
    name : str
        One of :data:`SEQUENCES`.
    motion : {"registered", "native"}
        ``registered`` removes the body's own rigid rotation; ``native`` takes the file as it is.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If it cannot be read, its layout is not the documented one, or the name or motion is unknown.
    """
    if motion not in MOTIONS:
        raise DatasetError(f"dataset.motion is {motion!r}, wanted one of {', '.join(MOTIONS)}")
    source = recording(name)
    path = folder / files(name, motion)[0]
    shape = (source.n_frames, 3, source.n_points)
    edges = no_edges()
    if path.name == SHARK_CAMERAS:
        S = _expect(path, "S", read_mat(path, ["S"])["S"], (3, source.n_points, source.n_frames)).transpose(2, 0, 1)
    elif source.layout == "blocks":
        stacked = _expect(path, "P3_gt", read_mat(path, ["P3_gt"])["P3_gt"], (3 * source.n_frames, source.n_points))
        S = stacked.reshape(3, source.n_frames, source.n_points).transpose(1, 0, 2)
    else:
        S = _expect(path, "S", read_mat(path, ["S"])["S"], (3 * source.n_frames, source.n_points)).reshape(shape)
        if source.registered == "stored":
            edges = _bones(path, source.n_points)
    if motion == "registered" and source.registered == "procrustes":
        S = register(S)
    return Body(name, np.ascontiguousarray(S), edges=edges, vertical=source.vertical, cameras=None, digest=sha256(path))


def load_recording(folder: Path, name: str) -> Body:
    """Read one sequence as it is stored, with the cameras of its own: the stored ``Rs``, or the fixed camera.

    The body keeps its own motion (``native``). Parameters and exceptions as for :func:`load_body`; a file whose
    tracks W are not R S raises DatasetError.
    """
    body = load_body(folder, name, "native")
    camera = recording(name).camera
    if camera != "Rs":
        rows = np.eye(3)[["xyz".index(axis) for axis in camera]]
        return replace(body, cameras=np.tile(rows, (body.n_frames, 1, 1)))
    path = folder / files(name, "native")[0]
    stored = read_mat(path, ["Rs", "W"])
    R = _expect(path, "Rs", stored["Rs"], (2 * body.n_frames, 3)).reshape(-1, 2, 3)
    W = _expect(path, "W", stored["W"], (2 * body.n_frames, body.n_points)).reshape(-1, 2, body.n_points)
    if not np.allclose(centre(project(R, body.structure)), centre(W), atol=1e-9 * np.abs(W).max()):
        raise DatasetError(f"{path}: the tracks W are not Rs S; fetch the file with 'nrsfm data get'")
    return replace(body, cameras=R)


def _expect(path: Path, field: str, value: Array, shape: tuple[int, ...]) -> Array:
    if value.shape != shape:
        raise DatasetError(f"{path}: field {field} has shape {value.shape}, wanted {shape}; is it the right file?")
    if not np.isfinite(value).all():
        raise DatasetError(f"{path}: field {field} holds NaN or infinite values; fetch it with 'nrsfm data get'")
    return value


def _bones(path: Path, n_points: int) -> NDArray[np.int64]:
    """The bones of ``list`` (1-based pairs of points)."""
    pairs = read_mat(path, ["list"])["list"]
    if pairs.ndim != 2 or pairs.shape[1] != 2 or not ((pairs >= 1) & (pairs <= n_points)).all():
        raise DatasetError(f"{path}: field list is not a list of pairs of the {n_points} points")
    return pairs.astype(np.int64) - 1


def load_single(
    folder: Path, name: str, *, scene: str | None = None, missing: Callable[[str, Recording], Body] | None = None
) -> Scene:
    """One sequence alone before its own cameras, as the single-body literature has it.

    ``missing`` makes the body that takes the place of an absent file, as in :func:`load_scene`; a body without
    cameras is circled at 5 degrees a frame.
    """
    try:
        body = load_recording(folder, name)
    except MissingData:
        if missing is None:
            raise
        body = missing(name, recording(name))
    return view(body if body.cameras is not None else replace(body, cameras=orbit(body.n_frames)), scene)


def load_scene(
    folder: Path,
    bodies: Sequence[str],
    *,
    motion: str = "registered",
    missing: Callable[[str, Recording], Body] | None = None,
    turn_upright: bool | Sequence[str] = False,
    **placement: Any,
) -> Scene:
    """Compose a scene of any of the eight sequences; ``placement`` goes to :func:`nrsfm.datasets.scene.compose`.

    ``turn_upright`` may name sequences that are not in the scene, so that one setting serves many scenes.
    ``missing`` makes the body that takes the place of a sequence whose file is absent; without it an absent
    file raises MissingData.
    """
    loaded = []
    for name in bodies:
        try:
            loaded.append(load_body(folder, name, motion))
        except MissingData:
            if missing is None:
                raise
            loaded.append(missing(name, recording(name)))
    if isinstance(turn_upright, list):
        if unknown := [name for name in turn_upright if name not in SEQUENCES]:
            raise DatasetError(f"dataset.upright names {unknown[0]!r}, which is none of {', '.join(SEQUENCES)}")
        turn_upright = [name for name in turn_upright if name in bodies]
    return compose(loaded, turn_upright=turn_upright, **placement)
