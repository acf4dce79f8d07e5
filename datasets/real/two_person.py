"""Two people in one room, as arrays: joints of dancers from the CMU motion capture database.

An .npz file of one take holds an array (F, J, 3) for each person, in metres and with y up, ``names`` (J,) of the
joints, ``parents`` (J,) with -1 for the root, and ``dt``, the seconds between frames. The first three frames show no
dance.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Body
from nrsfm.datasets.composition import captured
from nrsfm.datasets.errors import DatasetError, check_name, existing
from nrsfm.datasets.public.catalogue import sha256
from nrsfm.datasets.readers.limits import HUGE
from nrsfm.datasets.readers.npzfile import read_npz
from nrsfm.datasets.real.thinning import Thinning
from nrsfm.datasets.scene import Scene

SHIPPED = "dancers"
"""The take that comes with the package."""

FINGERS = ("Thumb", "Index", "Mid", "Ring", "Pinky")
FIRST = 3

HINT = (
    "it is no public file: a take of CMU subjects 60 and 61 (mocap.cs.cmu.edu), its joints as arrays 'lead60', "
    "'follow61', 'names', 'parents', 'dt'; set NRSFM_DATA to the folder that holds {folder}/"
)


def path(folder: Path, take: str) -> Path:
    """The file of a take: the package's own, or ``two_person/TAKE.npz``; raises MissingData if it is not there."""
    check_name("dataset.take", take)
    if take == SHIPPED:
        return Path(str(resources.files("nrsfm.datasets.shipped").joinpath(f"{take}.npz")))
    return existing(folder / "two_person" / f"{take}.npz", HINT)


def load(settings: Mapping[str, Any], folder: Path) -> Scene:
    """The two people of a take where they danced, without fingers, before one orbiting camera.

    The settings are those of ``conf/dataset/two_person.yaml``. Frames are counted after the first three.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If it cannot be read or its arrays do not fit each other.
    """
    file = path(folder, settings["take"])
    people, _, parents, dt, body = people_of(file, read_npz(file))
    place = np.cumsum(body) - 1  # of a joint among those kept
    bones = np.array([[place[p], place[k]] for k, p in enumerate(parents) if p >= 0 and body[k] and body[p]])
    shapes = {X.shape for X in people.values()}
    n_frames = next(iter(shapes))[0] - FIRST
    if len(shapes) > 1 or n_frames < 2:
        raise DatasetError(f"{file}: its people have shapes {sorted(shapes)}, wanted one shape (F, J, 3)")
    kept = Thinning.of(settings).frames(n_frames, 1 / dt)
    bodies = []
    for person, X in people.items():
        S = np.ascontiguousarray(X[FIRST:][kept][:, body].transpose(0, 2, 1), dtype=float)
        bodies.append(Body(person, S, edges=bones.reshape(-1, 2), vertical="y", digest=sha256(file)))
    return captured(bodies, name=settings["name"] or settings["take"], degrees_per_frame=settings["degrees_per_frame"])


def digest(settings: Mapping[str, Any], folder: Path) -> str:
    """SHA-256 of the take's file."""
    return sha256(path(folder, settings["take"]))


def people_of(
    file: Path, arrays: Mapping[str, NDArray[Any]]
) -> tuple[dict[str, NDArray[Any]], NDArray[Any], NDArray[Any], float, NDArray[np.bool_]]:
    """The people (F, J, 3) by name, the joints' names (J,), parents (J,), the time step, and which are no fingers (J,).

    Raises
    ------
    DatasetError
        If an array is missing or does not fit the people.
    """
    people = {key: value for key, value in arrays.items() if value.ndim == 3}
    for key in ("names", "parents", "dt"):
        if key not in arrays:
            known = ", ".join(ascii(name[:40]) for name in list(arrays)[:20])
            raise DatasetError(f"{file}: field {key} is missing (the file holds {known})")
    names, parents, dt = arrays["names"], arrays["parents"], arrays["dt"]
    joints = names.shape[0] if names.ndim == 1 else 0
    wrong = [key for key, X in people.items() if X.shape[1:] != (joints, 3) or X.dtype.kind != "f"]
    if wrong or not people:
        what = f"{wrong[0][:40]!a} has shape {people[wrong[0]].shape}" if wrong else "it holds no person"
        raise DatasetError(f"{file}: {what}, wanted numbers of shape (F, {joints}, 3)")
    if odd := [key for key, X in people.items() if not (np.abs(X.astype(float)) < HUGE).all()]:
        raise DatasetError(f"{file}: {odd[0][:40]!a} holds NaN or infinite values, or numbers above {HUGE:g}")
    whole = parents.shape == (joints,) and parents.dtype.kind == "i" and parents.size
    if not whole or parents.min() < -1 or parents.max() >= joints:
        raise DatasetError(f"{file}: field parents does not name the joints' parents")
    if dt.shape != () or dt.dtype.kind != "f" or not 0 < float(dt) < np.inf:
        raise DatasetError(f"{file}: field dt is no time between frames")
    body = np.array([not any(finger in str(joint) for finger in FINGERS) for joint in names])
    return people, names, parents, float(dt), body
