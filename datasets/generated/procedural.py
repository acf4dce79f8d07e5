"""Scenes of generated people and surfaces, which need no files.

Bodies deform and do not turn as a whole. The same settings give the same numbers on every machine.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from nrsfm.datasets.body import Body
from nrsfm.datasets.composition import compose, placement_of
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.generated.motion import VERSION, check_settings
from nrsfm.datasets.generated.people import activity_of, person
from nrsfm.datasets.generated.surfaces import SURFACES
from nrsfm.datasets.scene import Scene

KINDS = ("person", *SURFACES)
FACES = ("face", "shark")  # sequences whose stand-in is a surface


def load(settings: Mapping[str, Any], folder: Path) -> Scene:
    """The scene of the settings of ``conf/dataset/procedural.yaml``; no file is read."""
    shape = settings["bodies"], settings["points"], settings["frames"], settings["seed"]
    return load_scene(*shape, **placement_of(settings))


def digest(settings: Mapping[str, Any], folder: Path) -> str:
    """The generator's version."""
    return VERSION


def bodies(kinds: Sequence[str], n_points: int | Sequence[int], n_frames: int, seed: int = 0) -> list[Body]:
    """Bodies for one scene, with different names (person, person_2, face) and different activities.

    ``n_points`` is one number for all bodies, or a list with one for each; the rest is as for :func:`person`. Raises
    DatasetError, which names the setting as the configuration does, if one is out of range.
    """
    if not _listed(kinds) or not kinds or any(kind not in KINDS for kind in kinds):
        raise DatasetError(f"dataset.bodies is {kinds!r}, wanted a list of {', '.join(KINDS)}")
    counts: list[Any] = (
        list(n_points) if isinstance(n_points, Sequence) and _listed(n_points) else [n_points] * len(kinds)
    )
    if len(counts) != len(kinds):
        raise DatasetError(f"dataset.points holds {len(counts)} numbers for {len(kinds)} bodies; wanted one for each")
    made: list[Body] = []
    for k, (kind, count) in enumerate(zip(kinds, counts, strict=True)):
        check_settings(count, n_frames, seed)
        nth = sum(kind == other for other in kinds[:k])
        body_seed = seed if k == 0 else int(np.random.SeedSequence([seed, k]).generate_state(1)[0])
        if kind == "person":
            body = person(count, n_frames, body_seed, activity_of(seed, nth))
        else:
            body = SURFACES[kind](count, n_frames, body_seed)
        made.append(replace(body, name=f"{kind}_{nth + 1}" if nth else kind))
    return made


def stand_in(name: str, n_frames: int, n_points: int) -> Body:
    """A body that takes the place of an absent sequence: of its name and size, and marked as a stand-in.

    It is a face for :data:`FACES`, else a person. The seed comes from the name.
    """
    kind = "face" if name in FACES else "person"
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "little")
    return replace(bodies([kind], n_points, n_frames, seed)[0], name=name, stand_in=True)


def load_scene(kinds: Sequence[str], points: int | Sequence[int], frames: int, seed: int, **placement: Any) -> Scene:
    """A scene of generated bodies; ``placement`` goes to :func:`nrsfm.datasets.composition.compose`."""
    return compose(bodies(kinds, points, frames, seed), **placement)


def _listed(value: object) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)
