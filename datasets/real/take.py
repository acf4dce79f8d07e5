"""Takes of several people in one room, from C3D files: which marker belongs to whom, and when it was seen.

UMPM: van der Aa, Luo, Giezeman, Tan, Veltkamp, "UMPM benchmark: a multi-person dataset with synchronized video and
motion capture data", HACV 2011.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from nrsfm.datasets.body import Body, observed
from nrsfm.datasets.composition import captured
from nrsfm.datasets.errors import DatasetError, check_name, existing
from nrsfm.datasets.public.catalogue import sha256
from nrsfm.datasets.readers.c3dfile import read_c3d
from nrsfm.datasets.real.thinning import Thinning
from nrsfm.datasets.scene import Scene

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
OTHERS = ("none", "objects", "all")
PERSON = 15  # markers at least: the virtual markers of one person; balls, tables and chairs have fewer
UNLABELLED = "unlabelled"

HINTS = {
    "umpm": "ask for a login at umpm-mirror.cs.uu.nl and unpack {take}.zip into that folder",
    "c3d": "fetch the one of the catalogue with 'nrsfm data get c3d', or copy your own into that folder",
}


def load(settings: Mapping[str, Any], folder: Path) -> Scene:
    """The scene of the settings of ``conf/dataset/c3d.yaml`` or ``umpm.yaml``: see :func:`load_c3d`."""
    return load_c3d(
        find(folder, settings["folder"], settings["take"]),
        name=settings["name"] or settings["take"],
        persons=settings["persons"],
        others=settings["others"],
        vertical=settings["vertical"],
        thinning=Thinning.of(settings),
        degrees_per_frame=settings["degrees_per_frame"],
    )


def digest(settings: Mapping[str, Any], folder: Path) -> str:
    """SHA-256 of the take's file."""
    return sha256(find(folder, settings["folder"], settings["take"]))


def load_c3d(
    path: Path,
    *,
    name: str,
    persons: Sequence[str] | None = None,
    others: str = "none",
    vertical: str = "z",
    thinning: Thinning | None = None,
    degrees_per_frame: float = 5.0,
) -> Scene:
    """The people of a C3D file where they stood, before one orbiting camera.

    Parameters
    ----------
    path : Path
        The file.
    name : str
        Scene name.
    persons : sequence of str, optional
        Prefixes of labels; by default all that :func:`bodies` takes for people.
    others : {"none", "objects", "all"}
        Keep people alone; objects too, each a body; or unlabelled markers too, as one more body.
    vertical : {"y", "z"}
        The axis that points up.
    thinning : Thinning, optional
    degrees_per_frame : float
        The camera's step.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If it cannot be read, holds no such people, or a setting does not fit it.
    """
    markers, thin = read_c3d(path), thinning or Thinning()
    if markers.unit not in METRES:
        raise DatasetError(f"{path}: its unit of length is {markers.unit!a}, wanted mm, cm or m")
    groups = bodies(path, markers.labels, persons, others)
    points = METRES[markers.unit] * markers.points[thin.frames(len(markers.points), markers.rate)]
    parts = []
    for body, columns in groups.items():
        S = points[:, :, columns]
        S = S[:, :, thin.seen(observed(S))]
        if S.shape[2] == 0:
            raise DatasetError(f"{path}: no marker of {body!a} is seen often enough; see dataset.least_seen")
        parts.append(Body(body, S, vertical=vertical, digest=sha256(path), gaps=True))
    return captured(parts, name=name, degrees_per_frame=degrees_per_frame)


def find(folder: Path, group: str, take: str) -> Path:
    """The file of a take, ``GROUP/TAKE.c3d``, or below ``Groundtruth`` as UMPM's archives have it.

    Raises MissingData, which says how to get it, if it is not there; DatasetError if it would be elsewhere.
    """
    check_name("dataset.take", take)
    check_name("dataset.folder", group)
    unpacked = folder / group / "Groundtruth" / f"{take}.c3d"
    if unpacked.is_file():
        return unpacked
    hint = HINTS.get(group, "set NRSFM_DATA to the folder that holds {group}/").format(group=group, take=take)
    return existing(folder / group / f"{take}.c3d", hint)


def bodies(
    path: Path, labels: Sequence[str], persons: Sequence[str] | None = None, others: str = "none"
) -> Mapping[str, list[int]]:
    """Indices of the markers of each body, people first.

    ``LEFT:lkneefr`` is the marker lkneefr of the set LEFT; ``*12`` has no label. A set of 15 markers or more is a
    person, a smaller one an object. A name without a set is an object, unless there is no set at all. Then 15 names or
    more are one person, and in a file of virtual markers, ``*_vm.c3d``, every 15 are one person.

    ``persons`` and ``others`` are those of :func:`load_c3d`; ``path`` names the file in errors.

    Raises
    ------
    DatasetError
        If there is no person, a set of ``persons`` is not there, or a body has two markers of one label.
    """
    if others not in OTHERS:
        raise DatasetError(f"dataset.others is {others!r}, wanted one of {', '.join(OTHERS)}")
    sets: dict[str, list[int]] = {}
    for index, label in enumerate(labels):
        prefix, colon, _ = label.rpartition(":")
        sets.setdefault(UNLABELLED if label.startswith("*") or not label else prefix if colon else "", []).append(index)
    unlabelled, bare = sets.pop(UNLABELLED, []), sets.pop("", [])
    if not sets and len(bare) >= PERSON:
        sets = _in_order(bare) if path.stem.endswith("_vm") else {"person": bare}
        bare = []
    for markers in [*sets.values(), bare]:
        (label, times), *_ = [*Counter(labels[k] for k in markers).most_common(1), ("", 0)]
        if times > 1:
            raise DatasetError(f"{path}: {times} markers have the label {label!a}; name them apart")
    if isinstance(persons, str):
        raise DatasetError(f"dataset.persons is {persons!r}, wanted a list such as [{persons}]")
    people = list(persons) if persons is not None else [body for body, mine in sets.items() if len(mine) >= PERSON]
    unknown = [body for body in people if body not in sets]
    if unknown or not people:
        fault = f"dataset.persons names {unknown[0]!a}" if unknown else f"no {PERSON} markers are one person's"
        raise DatasetError(f"{path}: {fault}; its sets of markers are {', '.join(map(ascii, sets)) or 'none'}")
    groups = {body: sets.pop(body) for body in people}
    if others != "none":
        groups |= sets
        for k in bare:  # ball1 and ball2 are one ball
            groups.setdefault(re.sub(r"[\W_]*\d*$", "", labels[k]) or labels[k], []).append(k)
    if others == "all" and unlabelled:
        groups[UNLABELLED] = unlabelled
    return groups


def _in_order(markers: list[int]) -> dict[str, list[int]]:
    """Virtual markers of each person; 15 in a row are one person."""
    if len(markers) % PERSON:
        raise DatasetError(f"{len(markers)} virtual markers are not {PERSON} a person")
    return {f"person{k + 1}": markers[k * PERSON : (k + 1) * PERSON] for k in range(len(markers) // PERSON)}
