"""What installed packages bring: methods, sources of datasets, and configurations.

A package declares entry points in the groups ``nrsfm.methods`` (``NAME = "package.module:Class"``) and
``nrsfm.datasets`` (``NAME = "package.module"``). The ``conf`` folder beside such a module's top-level package
joins the configuration, behind the harness's own; nothing of the package is imported for that.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import resources
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path

from nrsfm import datasets, methods
from nrsfm.datasets.errors import DatasetError


def installed() -> list[EntryPoint]:
    """The entry points of all packages, methods first."""
    return [entry for group in (methods.ENTRY_POINTS, datasets.ENTRY_POINTS) for entry in entry_points(group=group)]


def folders() -> dict[str, Path]:
    """The folder of configurations of each package that has one, by the package's name; sorted by name."""
    found: dict[str, Path] = {}
    for entry in sorted(installed(), key=package_of):
        top = top_of(entry)
        spec = find_spec(top) if top.isidentifier() else None  # a top-level package is found, not imported
        for place in (spec.submodule_search_locations or ()) if spec else ():
            if (Path(place) / "conf").is_dir():
                found.setdefault(package_of(entry), Path(place) / "conf")
    return found


def choices(group: str) -> dict[str, tuple[str, str]]:
    """Names of a configuration group, each with its file's first line of comment and the package it is from.

    The package is "" for the harness's own. Of several files of one name, the first in the search path counts.
    """
    found: dict[str, tuple[str, str]] = {}
    for package, tree in [("", resources.files("nrsfm.conf")), *folders().items()]:
        if (folder := tree / group).is_dir():
            for file in folder.iterdir():
                if file.name.endswith(".yaml"):
                    lines = file.read_bytes().decode(errors="replace").splitlines()
                    comments = [line[1:].strip() for line in lines if line.startswith("# ")]
                    comments = [c for c in comments if not c.startswith("@package")]
                    found.setdefault(file.name.removesuffix(".yaml"), (comments[0] if comments else "", package))
    return dict(sorted(found.items()))


def faults() -> Iterator[str]:
    """What is wrong with installed packages, a line each: nothing that keeps the rest from working."""
    if not (entries := installed()):
        return
    from omegaconf import OmegaConf  # this and the registries take seconds, which only packages are worth

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
    """The top-level package or module that an entry point is of."""
    return entry.value.partition(":")[0].strip().partition(".")[0]


def package_of(entry: EntryPoint) -> str:
    """The distribution that declares an entry point."""
    return entry.dist.name if entry.dist else "?"
