"""Poses in JSON: OpenPose's files of frames, COCO's annotations and results, also a folder of them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.limits import reason
from nrsfm.datasets.readers.posetable import pose_tracks
from nrsfm.datasets.readers.trackfile import LONGEST, MOST, RECOGNISED, Asked, TrackFile, unused

LARGEST = 1 << 28  # bytes of all files; as Python's objects they take tenfold
PARTS = ("pose_keypoints_2d", "face_keypoints_2d", "hand_left_keypoints_2d", "hand_right_keypoints_2d")
IDENTITY = ("track_id", "idx", "instance_id")  # of a person in all frames: COCO's tracks, AlphaPose, CVAT
FRAME = ("frame_id", "file_name", "id")  # of an image, in the order in which they are looked for
REMEDY = "track them with the pose estimator, or leave one person in each frame"


@dataclass(frozen=True)
class Person:
    """A person in a frame: numbers x, y and confidence of each point."""

    frame: str
    name: str  # "" if the file has none
    points: list[Any]


@dataclass(frozen=True)
class Layout:
    """A layout of a document: how it is known, and the persons in it. A document of a folder is of the frame."""

    program: str
    knows: Callable[[Any], bool]
    persons: Callable[[Any, str], Iterator[Person]]
    nodes: Callable[[Any], list[str]]
    used: frozenset[str]


def read_json(path: Path, asked: Asked = RECOGNISED) -> TrackFile:
    """Read a JSON file, or the files of a folder, of which each is a frame.

    Points of confidence 0, and those below the wanted confidence, are not observed.

    Raises
    ------
    DatasetError
        If a file cannot be read or is of no known layout, or the persons of a frame cannot be told from frame to frame.
    """
    paths = sorted(path.glob("*.json")) if path.is_dir() else [path]
    if not paths or len(paths) > LONGEST or sum(part.stat().st_size for part in paths) > LARGEST:
        raise DatasetError(f"{path}: it holds no .json files, or more than {LARGEST >> 20} MiB of them")
    layout: Layout | None = None
    nodes: list[str] = []
    persons: list[Person] = []
    others: dict[str, None] = {}
    for part in paths:
        document = _loaded(part)
        layout = layout or next((one for one in LAYOUTS if one.knows(document)), None)
        if layout is None or not layout.knows(document):
            raise DatasetError(f"{part}: it is no file of OpenPose or COCO; wanted people, or annotations of keypoints")
        others |= dict.fromkeys(word for word in _keys(document) if word not in layout.used)
        try:
            nodes = nodes or layout.nodes(document)
            persons += layout.persons(document, _frame_of(part) if path.is_dir() else "")
        except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
            wanted = f"not as {layout.program} writes it"
            raise DatasetError(f"{part}: {wanted} ({type(error).__name__}: {reason(error)})") from None
    assert layout is not None
    found = _tracks(path, persons, nodes, asked)
    notes = [f"read as {layout.program} writes it", *found.notes, *unused("field", list(others))]
    return replace(found, notes=tuple(notes), image=True)


def _loaded(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError, OSError) as error:
        raise DatasetError(f"{path}: not a readable JSON file ({reason(error)}); write it again") from None


def _keys(document: Any) -> list[str]:
    """Names of a document's fields, or of those of the first entry of a list."""
    first = document[0] if isinstance(document, list) and document else document
    return list(first) if isinstance(first, Mapping) else []


def _frame_of(path: Path) -> str:
    return path.stem.removesuffix("_keypoints")


def _tracks(path: Path, persons: Sequence[Person], nodes: Sequence[str], asked: Asked) -> TrackFile:
    size = max((len(person.points) for person in persons), default=0)
    if size % 3 or not size:
        raise DatasetError(f"{path}: it holds no points; wanted numbers x, y and confidence for each")
    if len(persons) * size > 3 * MOST:
        raise DatasetError(f"{path}: it holds more than {MOST} observations; leave some out")
    once = len({person.frame for person in persons}) == len(persons)
    if not once and not all(person.name for person in persons):
        raise DatasetError(f"{path}: frames show several persons and the file does not say who is who; {REMEDY}")
    values = np.array([_numbers(path, person, size) for person in persons]).reshape(len(persons), -1, 3)
    least = 0.0 if asked.confidence is None else asked.confidence
    seen = np.asarray((values[:, :, 2] > 0) & (values[:, :, 2] >= least))
    kept = np.flatnonzero(seen.any(axis=1))  # a person without points was not found
    words = nodes if len(nodes) == size // 3 else [str(k) for k in range(size // 3)]
    names = None if once else [persons[k].name for k in kept.tolist()]
    frames = [persons[k].frame for k in kept.tolist()]
    positions = np.where(seen[:, :, None], values[:, :, :2], np.nan)[kept]
    return pose_tracks(path, frames, names, words, positions)


def _numbers(path: Path, person: Person, size: int) -> list[float]:
    """The numbers of a person; NaN for all if there are none."""
    points = person.points or [0.0] * size
    if len(points) != size or not all(isinstance(value, int | float) and abs(value) < math.inf for value in points):
        raise DatasetError(
            f"{path}: frame {person.frame[:40]!a} has {len(points)} numbers for a person, wanted {size} finite ones"
        )
    return [float(value) for value in points]


# OpenPose


def _is_openpose(document: Any) -> bool:
    return isinstance(document, dict) and isinstance(document.get("people"), list)


def _openpose(document: Any, frame: str) -> Iterator[Person]:
    for person in document["people"]:
        identity = person.get("person_id", [-1])
        number = identity[0] if isinstance(identity, list) else identity
        points = [value for part in PARTS for value in person.get(part) or []]
        yield Person(frame or "0", "" if number == -1 else str(number), points)


def _openpose_nodes(document: Any) -> list[str]:
    for person in document["people"]:
        sizes = {part.split("_keypoints")[0]: len(person.get(part) or []) // 3 for part in PARTS}
        return [f"{part}_{k}" for part, size in sizes.items() for k in range(size)]
    return []


# COCO


def _is_coco(document: Any) -> bool:
    if isinstance(document, list):
        return bool(document) and isinstance(document[0], dict) and {"image_id", "keypoints"} <= set(document[0])
    return isinstance(document, dict) and isinstance(document.get("annotations"), list)


def _coco(document: Any, frame: str) -> Iterator[Person]:
    """Annotations with their images, or results alone, which name the image."""
    held = document if isinstance(document, list) else document["annotations"]
    images = {} if isinstance(document, list) else {image["id"]: image for image in document.get("images", [])}
    key = next((key for key in FRAME if images and all(key in image for image in images.values())), "id")
    for person in held:
        image = images.get(person["image_id"], {})
        name = next((str(person[key]) for key in IDENTITY if key in person), "")
        yield Person(frame or str(image.get(key, person["image_id"])), name, list(person["keypoints"]))


def _coco_nodes(document: Any) -> list[str]:
    categories = [] if isinstance(document, list) else document.get("categories", [])
    return next((list(map(str, one["keypoints"])) for one in categories if "keypoints" in one), [])


LAYOUTS = (
    Layout("OpenPose", _is_openpose, _openpose, _openpose_nodes, frozenset({"people", "version"})),
    Layout(
        "COCO",
        _is_coco,
        _coco,
        _coco_nodes,
        frozenset({"images", "annotations", "categories", "info", "licenses", "image_id", "keypoints", *IDENTITY}),
    ),
)
