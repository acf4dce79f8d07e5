"""What installed packages bring: methods, sources of datasets, and configurations.

A package declares entry points in the groups ``nrsfm_harness.algorithms`` (``NAME = "package.module:Class"``) and
``nrsfm_harness.datasets`` (``NAME = "package.module"``). The ``conf`` folder beside such a module's top-level package
joins the configuration, behind the harness's own; nothing of the package is imported for that.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import resources
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hydra.core.config_search_path import ConfigSearchPath
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from datasets import registry as datasets
from datasets.body import DatasetError
from harness.environment import digest_of
from harness.record import Trial
from methods import registry as methods
from methods.base import MethodError


class Configurations(SearchPathPlugin):
    """Puts the configurations of installed packages into Hydra's search path, behind the harness's own."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        for package, folder in folders().items():
            search_path.append(package, f"file://{folder}")


def installed() -> list[EntryPoint]:
    """The entry points of all packages, methods first."""
    return [entry for group in (methods.ENTRY_POINTS, datasets.ENTRY_POINTS) for entry in entry_points(group=group)]


def packages_of(trial: Trial) -> str:
    """The installed packages that a trial's method and scene are from, "" for none: name, version, digest of source.

    ``nrsfm-example 0.1.0 3f2a91c0d4e5b678``: sources differ where somebody forgot to raise the version, too.
    """
    try:
        found = [methods.provider(name) for name in algorithms(trial.method)]
        found.append(datasets.provider(trial.dataset.get("source")))
    except (MethodError, DatasetError):  # a broken module of ours: the trial says so itself
        return ""
    return ", ".join(sorted({_described(_package(entry), _top(entry)) for entry in found if entry}))


def algorithms(method: Mapping[str, Any]) -> Iterator[str]:
    """The names of a method's algorithm and of those of its parts."""
    for key, value in method.items():
        if isinstance(value, Mapping):
            yield from algorithms(value)
        elif key == "algorithm":
            yield str(value)


@cache
def _described(package: str, top: str) -> str:
    try:
        release = version(package)
    except PackageNotFoundError:
        release = "?"
    spec = find_spec(top) if top.isidentifier() else None
    source = digest_of(Path(spec.origin)) if spec and spec.origin and Path(spec.origin).is_file() else "?"
    return f"{package} {release} {source}"


def folders() -> dict[str, Path]:
    """The folder of configurations of each package that has one, by the package's name; sorted by name."""
    found: dict[str, Path] = {}
    for entry in sorted(installed(), key=_package):
        top = _top(entry)
        spec = find_spec(top) if top.isidentifier() else None  # a top-level package is found, not imported
        for place in (spec.submodule_search_locations or ()) if spec else ():
            if (Path(place) / "conf").is_dir():
                found.setdefault(_package(entry), Path(place) / "conf")
    return found


def choices(group: str) -> dict[str, tuple[str, str]]:
    """Names of a configuration group, each with its file's first line of comment and the package it is from.

    The package is "" for the harness's own. Of several files of one name, the first in the search path counts.
    """
    found: dict[str, tuple[str, str]] = {}
    for package, tree in [("", resources.files("conf")), *folders().items()]:
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
    seen: dict[tuple[str, str], str] = {}
    for entry in installed():
        package = _package(entry)
        own = methods.ALGORITHMS if entry.group == methods.ENTRY_POINTS else datasets.SOURCES
        first = "the harness" if entry.name in own else seen.setdefault((entry.group, entry.name), package)
        if first != package:
            yield f"package {package}: {entry.name} is not used, {first} has one of that name; rename it"
            continue
        try:
            _ = methods.algorithm(entry.name) if own is methods.ALGORITHMS else datasets.source(entry.name)
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


def _top(entry: EntryPoint) -> str:
    """The top-level package or module that an entry point is of."""
    return entry.value.partition(":")[0].strip().partition(".")[0]


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else "?"
