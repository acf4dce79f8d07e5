"""The eight motion-capture sequences of the non-rigid structure-from-motion literature.

drink, pickup, yoga, stretch, dance: Akhter, Sheikh, Khan, Kanade, "Trajectory Space", PAMI 2011.
face, walking, shark: Torresani, Hertzmann, Bregler, PAMI 2008 (the shark is stored as ``jaws``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array, Body, no_edges
from nrsfm.datasets.composition import compose, placement_of
from nrsfm.datasets.errors import DatasetError, existing
from nrsfm.datasets.generated.motion import VERSION
from nrsfm.datasets.generated.procedural import stand_in as generated_body
from nrsfm.datasets.public.catalogue import sha256
from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.datasets.registration import REGISTRATIONS
from nrsfm.datasets.scene import Scene


@dataclass(frozen=True)
class Recording:
    """File, size and layout of a sequence.

    ``layout`` is ``interleaved``, field S (3F, P) with rows x, y, z for each frame; or ``blocks``, field P3_gt (3F, P)
    with F rows of x, then of y, then of z. ``registered`` is the file that holds the body without its own rotation: the
    same, another, or "" for none; then the rotation is removed by a rule of
    :data:`nrsfm.datasets.registration.REGISTRATIONS`. ``camera`` is that of the published reconstructions: ``Rs``, the
    field with a camera for each frame, or the two axes of a fixed camera's image.
    """

    file: str
    n_frames: int
    n_points: int
    layout: str = "interleaved"
    registered: str = ""
    camera: str = "Rs"

    @property
    def vertical(self) -> str:
        return "z" if self.layout == "interleaved" else "y"


SHARK_CAMERAS = "jaws_cameras.mat"

SEQUENCES: Mapping[str, Recording] = {
    "drink": Recording("drink.mat", 1102, 41, registered="drink.mat"),
    "pickup": Recording("pickup.mat", 357, 41, registered="pickup.mat"),
    "yoga": Recording("yoga.mat", 307, 41, registered="yoga.mat"),
    "stretch": Recording("stretch.mat", 370, 41, registered="stretch.mat"),
    "dance": Recording("dance.mat", 264, 75, camera="yz"),
    "face": Recording("face.mat", 316, 40, layout="blocks", camera="xy"),
    "walking": Recording("walking.mat", 260, 55, layout="blocks", camera="xy"),
    "shark": Recording("jaws.mat", 240, 91, layout="blocks", registered=SHARK_CAMERAS, camera="xy"),
}

MOTIONS = ("registered", "native")


def recording(name: str) -> Recording:
    """A sequence by name; raises DatasetError that lists the names."""
    if name not in SEQUENCES:
        raise DatasetError(f"dataset.bodies names {name!r}, which is none of {', '.join(SEQUENCES)}")
    return SEQUENCES[name]


def file_of(name: str, motion: str = "registered") -> str:
    """The file, relative to the data folder, that :func:`load_body` reads."""
    source = recording(name)
    return f"mocap/{(motion == 'registered' and source.registered) or source.file}"


def load(settings: Mapping[str, Any], folder: Path) -> Scene:
    """The scene of the settings of ``conf/dataset/mocap_scene.yaml``."""
    return load_scene(
        folder,
        settings["bodies"],
        motion=settings["motion"],
        registration=settings["registration"],
        stand_in=settings["stand_in"],
        n_frames=settings["frames"],
        **placement_of(settings),
    )


def digest(settings: Mapping[str, Any], folder: Path) -> str:
    """Digests of the bodies of :func:`load`."""
    motion, generated = settings["motion"], settings["stand_in"]
    return " ".join(body_digest(folder, name, motion, generated) for name in settings["bodies"])


def body_digest(folder: Path, name: str, motion: str, stand_in: bool) -> str:
    """SHA-256 of a sequence's file; the generator's version if its stand-in takes its place."""
    path = folder / file_of(name, motion)
    return VERSION if stand_in and not path.is_file() else sha256(existing(path))


def load_body(
    folder: Path, name: str, motion: str = "registered", registration: str = "turn", stand_in: bool = False
) -> Body:
    """Read one sequence.

    Parameters
    ----------
    folder : Path
        The data folder, which holds ``mocap/``.
    name : str
        One of :data:`SEQUENCES`.
    motion : {"registered", "native"}
        ``registered`` takes the body without its own rotation; ``native`` takes the sequence's file as it is.
    registration : {"procrustes", "turn", "stored"}
        The rule of :data:`nrsfm.datasets.registration.REGISTRATIONS` for registered bodies that no file holds without
        their rotation.
    stand_in : bool
        Generate a body of the same size if the file is not there.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If it cannot be read, its layout is not the documented one, or the name, motion or registration is unknown.
    """
    if motion not in MOTIONS:
        raise DatasetError(f"dataset.motion is {motion!r}, wanted one of {', '.join(MOTIONS)}")
    if registration not in REGISTRATIONS:
        raise DatasetError(f"dataset.registration is {registration!r}, wanted one of {', '.join(REGISTRATIONS)}")
    source = recording(name)
    path = folder / file_of(name, motion)
    F, P = source.n_frames, source.n_points
    if stand_in and not path.is_file():
        return generated_body(name, F, P)
    edges = no_edges()
    if path.name == SHARK_CAMERAS:
        S = expect(path, "S", read_mat(path, ["S"]), (3, P, F)).transpose(2, 0, 1)
    elif source.layout == "blocks":
        S = expect(path, "P3_gt", read_mat(path, ["P3_gt"]), (3 * F, P)).reshape(3, F, P).transpose(1, 0, 2)
    else:
        with_bones = source.registered == source.file
        fields = read_mat(path, ["S", "list"] if with_bones else ["S"])
        S = expect(path, "S", fields, (3 * F, P)).reshape(F, 3, P)
        edges = _bones(path, fields["list"], P) if with_bones else edges
    if motion == "registered" and not source.registered:
        S = REGISTRATIONS[registration](S, source.vertical)
    return Body(name, np.ascontiguousarray(S), edges=edges, vertical=source.vertical, digest=sha256(path))


def expect(path: Path, name: str, fields: Mapping[str, Array], shape: tuple[int, ...]) -> Array:
    """A field of a file; raises DatasetError unless it has the shape and all its numbers are finite."""
    value = fields[name]
    if value.shape != shape:
        raise DatasetError(f"{path}: field {name} has shape {value.shape}, wanted {shape}; is it the right file?")
    if not np.isfinite(value).all():
        raise DatasetError(f"{path}: field {name} holds NaN or infinite values; fetch it with 'nrsfm data get'")
    return value


def _bones(path: Path, pairs: Array, n_points: int) -> NDArray[np.int64]:
    """Edges (E, 2) of the field ``list``, which counts the points from 1."""
    if pairs.ndim != 2 or pairs.shape[1] != 2 or not ((pairs >= 1) & (pairs <= n_points)).all():
        raise DatasetError(f"{path}: field list is not a list of pairs of the {n_points} points")
    return pairs.astype(np.int64) - 1


def load_scene(
    folder: Path,
    bodies: Sequence[str],
    *,
    motion: str = "registered",
    registration: str = "turn",
    stand_in: bool = False,
    turn_upright: bool | Sequence[str] = False,
    **placement: Any,
) -> Scene:
    """Compose a scene of any of the eight sequences.

    Parameters
    ----------
    folder, motion, registration, stand_in
        As for :func:`load_body`.
    bodies : sequence of str
        Names of sequences.
    turn_upright : bool or names of sequences
        As for :func:`nrsfm.datasets.composition.compose`. Sequences that are not in the scene may be named, so that one
        setting serves many scenes.
    placement
        Further arguments of :func:`nrsfm.datasets.composition.compose`.
    """
    loaded = [load_body(folder, name, motion, registration, stand_in) for name in bodies]
    if isinstance(turn_upright, list):
        if unknown := [name for name in turn_upright if name not in SEQUENCES]:
            raise DatasetError(f"dataset.upright names {unknown[0]!r}, which is none of {', '.join(SEQUENCES)}")
        turn_upright = [name for name in turn_upright if name in bodies]
    return compose(loaded, turn_upright=turn_upright, **placement)
