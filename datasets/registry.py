"""Scenes by the settings of the ``dataset`` group.

A source of one's own is a module with two functions, ``load(settings, folder)``, which gives a Scene, and
``digest(settings, folder)``, which gives the identity of the data in one line without making the scene. It stands in
``datasets/NAME.py``, or in an installed package under the entry point group ``nrsfm.datasets``,
``NAME = "package.module"``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from nrsfm.datasets import ENTRY_POINTS
from nrsfm.datasets.body import Body
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.generated import procedural
from nrsfm.datasets.generated.motion import VERSION
from nrsfm.datasets.public import catalogue as sources
from nrsfm.datasets.real import garg, hopkins, mocap, take, tracks, two_person
from nrsfm.datasets.real.thinning import Thinning
from nrsfm.datasets.scene import Scene

Settings = Mapping[str, Any]


def load_scene(settings: Settings, folder: Path, stand_in: bool = False) -> Scene:
    """The scene that the settings describe.

    Parameters
    ----------
    settings : mapping
        ``source`` (see :func:`source`), ``name``, and the source's own settings; see
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
    return source(settings.get("source"))[0](settings, folder, stand_in)


def digest(settings: Settings, folder: Path, stand_in: bool = False) -> str:
    """Identity of the data behind a scene, without making it: hashes of the files, or the generator's version."""
    return source(settings.get("source"))[1](settings, folder, stand_in)


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
            parts.append(VERSION)
        else:
            raise MissingData(f"{path} is not there; fetch it with 'nrsfm data get' or set NRSFM_DATA to its folder")
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
    return VERSION


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


def _tracks(settings: Settings, folder: Path, stand_in: bool) -> Scene:
    return tracks.load_tracks(tracks.find(settings["file"], folder), settings["name"])


def _tracks_digest(settings: Settings, folder: Path, stand_in: bool) -> str:
    path = tracks.find(settings["file"], folder)
    if not path.is_file():
        raise MissingData(f"{path} is not there; dataset.file names a file from the current folder or the data folder")
    return sources.sha256(path)


Source = tuple[Callable[[Settings, Path, bool], Scene], Callable[[Settings, Path, bool], str]]


SOURCES: dict[str, Source] = {
    "mocap": (_mocap, _mocap_digest),
    "mocap_body": (_mocap_body, _mocap_body_digest),
    "procedural": (_procedural, _procedural_digest),
    "hopkins155": (_hopkins, _hopkins_digest),
    "take": (_take, _take_digest),
    "two_person": (_two_person, _two_person_digest),
    "garg": (_garg, _garg_digest),
    "tracks": (_tracks, _tracks_digest),
}


def source(name: object) -> Source:
    """How the scenes of a source are made and identified: ours, that of ``datasets/NAME.py``, or a package's.

    Raises
    ------
    DatasetError
        If there is no such source, with the names that there are; or if its module cannot be imported, or lacks one of
        the two functions.
    """
    if name in SOURCES:
        return SOURCES[str(name)]
    word = str(name)
    if own := _of_module(word):
        return _wrapped(word, own)
    theirs = others()
    if name not in theirs:  # it may have come since
        others.cache_clear()
        theirs = others()
    if name not in theirs:
        raise DatasetError(f"dataset.source is {name!r}, wanted one of {', '.join([*SOURCES, *sorted(theirs)])}")
    entry = theirs[word]
    package = entry.dist.name if entry.dist else "?"
    where = f"dataset {word} of the installed package {package}"
    found = _loaded(where, entry.load, f"mend it or uninstall {package}")
    if not _is_source(found):
        raise DatasetError(f"{where} is {found!r}, wanted a module with the functions load and digest")
    return _wrapped(word, found)


def provider(name: object) -> EntryPoint | None:
    """The entry point of the installed package that brings a source; None for one of ours, or for none.

    Raises DatasetError if a module of ours has the name and cannot be imported.
    """
    return None if name in SOURCES or _of_module(str(name)) else others().get(str(name))


@cache
def others() -> Mapping[str, EntryPoint]:
    """The sources that installed packages add, by name; not imported yet. Of one name the first counts."""
    return {entry.name: entry for entry in reversed(tuple(entry_points(group=ENTRY_POINTS)))}


def _of_module(name: str) -> ModuleType | None:
    """``datasets/NAME.py``, if it is there and a source."""
    if not (name.isidentifier() and find_spec(f"nrsfm.datasets.{name}")):
        return None
    found = _loaded(f"datasets/{name}.py", lambda: import_module(f"nrsfm.datasets.{name}"), f"mend datasets/{name}.py")
    return found if _is_source(found) else None


def _loaded(where: str, load: Callable[[], Any], remedy: str) -> Any:
    try:
        return load()
    except Exception as error:
        raise DatasetError(f"{where} cannot be imported: {type(error).__name__}: {error}; {remedy}") from error


def _is_source(found: object) -> bool:
    return all(callable(getattr(found, part, None)) for part in ("load", "digest"))


def _wrapped(name: str, module: ModuleType) -> Source:
    """A module's two functions; what they raise becomes a DatasetError, and what they give is held to its kind."""

    def call(part: str, kind: type, settings: Settings, folder: Path) -> Any:
        try:
            found = getattr(module, part)(dict(settings), folder)
        except DatasetError:
            raise
        except Exception as error:
            said = f"{type(error).__name__}: {error}"
            raise DatasetError(f"dataset {name}: {part} ended with {said}; mend {module.__name__}") from error
        if not isinstance(found, kind) or found == "":
            given = f"an empty {kind.__name__}" if isinstance(found, kind) else type(found).__name__
            raise DatasetError(f"dataset {name}: {part} gave {given}, wanted a {kind.__name__}")
        return found

    return (
        lambda settings, folder, _stand_in: call("load", Scene, settings, folder),
        lambda settings, folder, _stand_in: call("digest", str, settings, folder),
    )
