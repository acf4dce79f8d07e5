"""Finds methods, datasets and configurations of installed packages by their entry points.

A package declares entry points in the groups ``nrsfm.methods`` (``NAME = "package.module:Class"``) and
``nrsfm.datasets`` (``NAME = "package.module"``). The folder ``conf`` in the top-level package of such a module is
added to Hydra's search path, after the harness's own. The package is not imported for that.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator
from importlib import resources
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path

from nrsfm import datasets, methods
from nrsfm.datasets.errors import DatasetError
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.text import did_you_mean


def installed() -> list[EntryPoint]:
    """The entry points of all packages, methods first."""
    return [entry for group in (methods.ENTRY_POINTS, datasets.ENTRY_POINTS) for entry in entry_points(group=group)]


def folders() -> dict[str, Path]:
    """The ``conf`` folder of each package that has one, by the name of the package, sorted."""
    by_package: dict[str, Path] = {}
    for entry in sorted(installed(), key=package_of):
        top = top_of(entry)
        spec = find_spec(top) if top.isidentifier() else None  # finding a top-level package does not import it
        for place in (spec.submodule_search_locations or ()) if spec else ():
            if (Path(place) / "conf").is_dir():
                by_package.setdefault(package_of(entry), Path(place) / "conf")
    return by_package


def choices(group: str) -> dict[str, tuple[str, str]]:
    """The choices of a configuration group: name -> the first sentence of its file's comment, and its package.

    The package is "" for the harness itself. Of files of the same name, the first in the search path is used.
    """
    described: dict[str, tuple[str, str]] = {}
    for package, tree in [("", resources.files("nrsfm.conf")), *folders().items()]:
        if (folder := tree / group).is_dir():
            for file in folder.iterdir():
                if file.name.endswith(".yaml"):
                    sentence = _first_sentence(file.read_bytes().decode(errors="replace"))
                    described.setdefault(file.name.removesuffix(".yaml"), (sentence, package))
    return dict(sorted(described.items()))


def _first_sentence(text: str) -> str:
    """The first sentence of the comment that a yaml file begins with, which may go over several lines."""
    lines = itertools.takewhile(lambda line: line.startswith("#"), text.splitlines())
    prose = itertools.takewhile(lambda line: not line.startswith("#  "), (x for x in lines if "@package" not in x))
    comment = " ".join(line[1:].strip() for line in prose)
    return re.split(r"(?<!\bal\.)(?<=\.)\s", comment, maxsplit=1)[0]


def check_choices(overrides: Iterable[str]) -> None:
    """Raise UsageError if ``GROUP=NAME`` or ``GROUP=NAME,NAME`` names a choice without a file; does not load Hydra.

    What is more than names is left to Hydra, and so are all where files are added to its search path.
    """
    words = list(overrides)
    if any(word.startswith("hydra.searchpath=") for word in words):
        return
    for word in words:
        if match := re.fullmatch(r"\+?(\w+)=([\w.-]+(?:,[\w.-]+)*)", word):
            known = choices(match[1])
            for name in match[2].split(","):
                if known and name.removesuffix(".yaml") not in (*known, "null"):
                    raise UsageError(unknown_choice(match[1], name, known))


def unknown_choice(group: str, name: str, known: Iterable[str]) -> str:
    """A line that says so."""
    return f"{group} {name!r} is none of {', '.join(known)}{did_you_mean(name, known)}"


def faults() -> Iterator[str]:
    """Faults of installed packages, one line each: names that are taken, modules and files that cannot be loaded."""
    if not (entries := installed()):
        return
    from omegaconf import OmegaConf  # slow imports, needed only if there are packages

    from nrsfm.datasets.registry import SOURCES, source
    from nrsfm.methods.base import MethodError
    from nrsfm.methods.registry import ALGORITHMS, algorithm

    seen: dict[tuple[str, str], str] = {}
    for entry in entries:
        package = package_of(entry)
        own = ALGORITHMS if entry.group == methods.ENTRY_POINTS else SOURCES
        first = "the harness" if entry.name in own else seen.setdefault((entry.group, entry.name), package)
        if first != package:
            yield f"package {package}: {entry.name} is not used, {first} has one of that name; rename it"
            continue
        try:
            _ = algorithm(entry.name) if own is ALGORITHMS else source(entry.name)
        except (MethodError, DatasetError) as error:
            yield " ".join(str(error).split())
    for package, folder in folders().items():
        for file in sorted(folder.glob("*/*.yaml")):
            name = f"{file.parent.name}/{file.stem}"
            try:
                OmegaConf.load(file)
            except Exception as error:
                yield f"package {package}: {file} cannot be read: {' '.join(str(error).split())}; mend it"
            first = choices(file.parent.name)[file.stem][1] or "the harness"
            if first != package:
                yield f"package {package}: {name} is not used, {first} has one of that name; rename it"


def top_of(entry: EntryPoint) -> str:
    """The top-level package or module of an entry point."""
    return entry.value.partition(":")[0].strip().partition(".")[0]


def package_of(entry: EntryPoint) -> str:
    """The distribution that declares an entry point."""
    return entry.dist.name if entry.dist else "?"
