"""Scenes by the settings of the ``dataset`` group."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from datasets import garg, hopkins, mocap, procedural, sources, take, two_person
from datasets.body import Body, DatasetError, MissingData
from datasets.scene import Scene
from datasets.thinning import Thinning

Settings = Mapping[str, Any]


def load_scene(settings: Settings, folder: Path, stand_in: bool = False) -> Scene:
    """The scene that the settings describe.

    Parameters
    ----------
    settings : mapping
        ``source`` (a key of :data:`SOURCES`), ``name``, and the source's own settings; see
        ``conf/dataset``.
    folder : Path
        The data folder.
    stand_in : bool
        Let generated bodies of the same size take the place of real sequences that are not there.

    Raises
    ------
    DatasetError
        If a setting or a file cannot be used; MissingData if a file is absent.
    """
    return _source(settings)[0](settings, folder, stand_in)


def digest(settings: Settings, folder: Path, stand_in: bool = False) -> str:
    """Identity of the data behind a scene, without making it: hashes of the files, or the generator's version."""
    return _source(settings)[1](settings, folder, stand_in)


def _placement(settings: Settings) -> dict[str, Any]:
    return {
        "name": settings["name"],
        "placement": settings["placement"],
        "turn_upright": settings["upright"],
        "scale": settings["scale"],
        "degrees_per_frame": settings["degrees_per_frame"],
    }


def _generated(name: str, source: mocap.Recording) -> Body:
    kind = "face" if name in ("face", "shark") else "person"
    return procedural.stand_in(name, source.n_frames, source.n_points, kind)


def _mocap(settings: Settings, folder: Path, stand_in: bool) -> Scene:
    return mocap.load_scene(
        folder,
        settings["bodies"],
        motion=settings["motion"],
        missing=_generated if stand_in else None,
        n_frames=settings["frames"],
        **_placement(settings),
    )


def _mocap_digest(settings: Settings, folder: Path, stand_in: bool) -> str:
    return _files_digest(settings["bodies"], settings["motion"], folder, stand_in)


def _files_digest(bodies: Iterable[str], motion: str, folder: Path, stand_in: bool) -> str:
    parts = []
    for name in bodies:
        path = folder / mocap.files(name, motion)[0]
        if path.is_file():
            parts.append(sources.sha256(path))
        elif stand_in:
            parts.append(procedural.VERSION)
        else:
            raise MissingData(f"{path} is not there; fetch it with 'harness data get' or set NRSFM_DATA to its folder")
    return " ".join(parts)


def _mocap_body(settings: Settings, folder: Path, stand_in: bool) -> Scene:
    missing = _generated if stand_in else None
    return mocap.load_single(folder, settings["body"], scene=settings["name"], missing=missing)


def _mocap_body_digest(settings: Settings, folder: Path, stand_in: bool) -> str:
    return _files_digest([settings["body"]], "native", folder, stand_in)


def _procedural(settings: Settings, folder: Path, stand_in: bool) -> Scene:
    return procedural.load_scene(
        settings["bodies"], settings["points"], settings["frames"], settings["seed"], **_placement(settings)
    )


def _procedural_digest(settings: Settings, folder: Path, stand_in: bool) -> str:
    return procedural.VERSION


def _hopkins(settings: Settings, folder: Path, stand_in: bool) -> Scene:
    return hopkins.load_scene(folder, settings["scene"])


def _hopkins_digest(settings: Settings, folder: Path, stand_in: bool) -> str:
    return sources.sha256(hopkins.path(folder, settings["scene"]))


def _thinning(settings: Settings) -> Thinning:
    return Thinning(
        video_rate=settings.get("video_rate"),
        span=settings["range"],
        stride=settings["stride"],
        most=settings["frames"],
        least_seen=settings.get("least_seen", 0.0),
    )


def _take(settings: Settings, folder: Path, stand_in: bool) -> Scene:
    return take.load_take(
        folder,
        settings["folder"],
        settings["take"],
        name=settings["name"],
        persons=settings["persons"],
        others=settings["others"],
        vertical=settings["vertical"],
        thinning=_thinning(settings),
        degrees_per_frame=settings["degrees_per_frame"],
    )


def _take_digest(settings: Settings, folder: Path, stand_in: bool) -> str:
    return sources.sha256(take.find(folder, settings["folder"], settings["take"]))


def _two_person(settings: Settings, folder: Path, stand_in: bool) -> Scene:
    return two_person.load_scene(
        folder,
        settings["take"],
        name=settings["name"],
        thinning=_thinning(settings),
        degrees_per_frame=settings["degrees_per_frame"],
    )


def _two_person_digest(settings: Settings, folder: Path, stand_in: bool) -> str:
    return sources.sha256(two_person.path(folder, settings["take"]))


def _garg(settings: Settings, folder: Path, stand_in: bool) -> Scene:
    return garg.load_scene(
        folder,
        settings["sequence"],
        name=settings["name"],
        points=settings["points"],
        frames=settings["frames"],
        neighbours=settings["neighbours"],
        fields=settings["fields"],
    )


def _garg_digest(settings: Settings, folder: Path, stand_in: bool) -> str:
    return sources.sha256(garg.path(folder, settings["sequence"]))


Source = tuple[Callable[[Settings, Path, bool], Scene], Callable[[Settings, Path, bool], str]]
SOURCES: dict[str, Source] = {
    "mocap": (_mocap, _mocap_digest),
    "mocap_body": (_mocap_body, _mocap_body_digest),
    "procedural": (_procedural, _procedural_digest),
    "hopkins155": (_hopkins, _hopkins_digest),
    "take": (_take, _take_digest),
    "two_person": (_two_person, _two_person_digest),
    "garg": (_garg, _garg_digest),
}


def _source(settings: Settings) -> Source:
    if settings.get("source") not in SOURCES:
        raise DatasetError(f"dataset.source is {settings.get('source')!r}, wanted one of {', '.join(SOURCES)}")
    return SOURCES[settings["source"]]
