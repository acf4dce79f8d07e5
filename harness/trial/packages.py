"""The installed packages that a trial's results come from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from nrsfm.datasets import registry as datasets
from nrsfm.datasets.errors import DatasetError
from nrsfm.harness.config.plugins import package_of, top_of
from nrsfm.harness.record.environment import digest_of
from nrsfm.harness.record.trial import Trial
from nrsfm.methods import registry as methods
from nrsfm.methods.base import MethodError


def packages_of(trial: Trial) -> str:
    """The packages that bring a trial's method and scene, "" for none: name, version, digest of the source.

    ``nrsfm-example 0.1.0 3f2a91c0d4e5b678``: sources differ where somebody forgot to raise the version, too.
    """
    try:
        found = [methods.provider(name) for name in _algorithms(trial.method)]
        found.append(datasets.provider(trial.dataset.get("source")))
    except (MethodError, DatasetError):  # a broken module of ours: the trial says so itself
        return ""
    return ", ".join(sorted({described(package_of(entry), top_of(entry)) for entry in found if entry}))


@cache
def described(package: str, top: str) -> str:
    """Name, version and source of a package whose modules stand under ``top``; once for a process."""
    try:
        release = version(package)
    except PackageNotFoundError:
        release = "?"
    spec = find_spec(top) if top.isidentifier() else None
    source = digest_of(Path(spec.origin)) if spec and spec.origin and Path(spec.origin).is_file() else "?"
    return f"{package} {release} {source}"


def _algorithms(method: Mapping[str, Any]) -> Iterator[str]:
    """The names of a method's algorithm and of those of its parts."""
    for key, value in method.items():
        if isinstance(value, Mapping):
            yield from _algorithms(value)
        elif key == "algorithm":
            yield str(value)
