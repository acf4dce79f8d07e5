"""Sources of scenes by name, and the scene that the settings of the ``dataset`` group describe.

A source is a module with two functions, ``load(settings, folder)``, which returns a Scene, and
``digest(settings, folder)``, which returns the identity of the data in one line without making the scene. ``folder`` is
the data folder. ``settings["stand_in"]`` is true if generated bodies may take the place of files that are not there.

The project's own sources are listed in :data:`SOURCES`. Others are modules ``datasets/NAME.py``, or modules of
installed packages under the entry point group ``nrsfm.datasets``, ``NAME = "package.module"``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from nrsfm.datasets import ENTRY_POINTS
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.generated import procedural
from nrsfm.datasets.real import garg, hopkins, mocap, mocap_body, take, tracks, two_person
from nrsfm.datasets.scene import Scene

T = TypeVar("T", Scene, str)
Settings = Mapping[str, Any]

SOURCES: Mapping[str, ModuleType] = {
    "mocap": mocap,
    "mocap_body": mocap_body,
    "procedural": procedural,
    "hopkins155": hopkins,
    "take": take,
    "two_person": two_person,
    "garg": garg,
    "tracks": tracks,
}


def load_scene(settings: Settings, folder: Path, stand_in: bool = False) -> Scene:
    """The scene that the settings describe.

    Parameters
    ----------
    settings : mapping
        ``source`` (see :func:`source`), ``name``, and the source's own settings; see ``conf/dataset``.
    folder : Path
        The data folder.
    stand_in : bool
        Let generated bodies of the same size take the place of real sequences that are not there.

    Raises
    ------
    DatasetError
        If a setting or a file cannot be used; MissingData if a file is absent.
    """
    return _call("load", Scene, settings, folder, stand_in)


def digest(settings: Settings, folder: Path, stand_in: bool = False) -> str:
    """Identity of the data behind a scene, without making it: hashes of the files, or the generator's version."""
    return _call("digest", str, settings, folder, stand_in)


def source(name: object) -> ModuleType:
    """The module that makes the scenes of a source: the project's own, ``datasets/NAME.py``, or a package's.

    Raises
    ------
    DatasetError
        If there is no such source, with the names that there are; or if its module cannot be imported, or lacks one of
        the two functions.
    """
    word = str(name)
    if module := SOURCES.get(word) or _local_module(word):
        return module
    if word not in others():  # it may have been installed since
        others.cache_clear()
    if word not in others():
        raise DatasetError(f"dataset.source is {name!r}, wanted one of {', '.join([*SOURCES, *sorted(others())])}")
    entry = others()[word]
    package = entry.dist.name if entry.dist else "?"
    place = f"dataset {word} of the installed package {package}"
    plugin = _imported(place, entry.load, f"mend it or uninstall {package}")
    if not _is_source(plugin):
        raise DatasetError(f"{place} is {plugin!r}, wanted a module with the functions load and digest")
    return plugin


def provider(name: object) -> EntryPoint | None:
    """The entry point of the installed package that brings a source; None for one of this checkout, or for none.

    Raises DatasetError if a module of this checkout has the name and cannot be imported.
    """
    return None if name in SOURCES or _local_module(str(name)) else others().get(str(name))


@cache
def others() -> Mapping[str, EntryPoint]:
    """Sources of installed packages by name, not imported yet. Of two with one name the first counts."""
    return {entry.name: entry for entry in reversed(tuple(entry_points(group=ENTRY_POINTS)))}


def _local_module(name: str) -> ModuleType | None:
    """``datasets/NAME.py``, if it is there and a source."""
    module = f"nrsfm.datasets.{name}"
    if not (name.isidentifier() and find_spec(module)):
        return None
    source_module = _imported(f"datasets/{name}.py", lambda: import_module(module), f"mend datasets/{name}.py")
    return source_module if _is_source(source_module) else None


def _imported(place: str, load: Callable[[], ModuleType], remedy: str) -> ModuleType:
    try:
        return load()
    except Exception as error:
        raise DatasetError(f"{place} cannot be imported: {type(error).__name__}: {error}; {remedy}") from error


def _is_source(module: object) -> bool:
    return all(callable(getattr(module, function, None)) for function in ("load", "digest"))


def _call(function: str, kind: type[T], settings: Settings, folder: Path, stand_in: bool) -> T:
    """The result of a source's function; DatasetError if a plugin fails, or the result is not a ``kind``."""
    name, module = settings.get("source"), source(settings.get("source"))
    try:
        result = getattr(module, function)({**settings, "stand_in": stand_in}, folder)
    except (DatasetError, MemoryError):
        raise
    except Exception as error:
        if name in SOURCES:  # a defect of the project, shown with its traceback
            raise
        reason = f"{type(error).__name__}: {error}"
        raise DatasetError(f"dataset {name}: {function} ended with {reason}; mend {module.__name__}") from error
    if not isinstance(result, kind) or result == "":
        returned = f"an empty {kind.__name__}" if isinstance(result, kind) else type(result).__name__
        raise DatasetError(f"dataset {name}: {function} gave {returned}, wanted a {kind.__name__}")
    return result
