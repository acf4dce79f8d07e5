"""Name, version and source digest of the installed packages that bring a trial's method and scene."""

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
    """The packages that bring a trial's method and scene, as ``nrsfm-example 0.1.0 3f2a91c0d4e5b678``; "" for none.

    The digest tells sources apart even if their version was not raised.
    """
    try:
        entries = [methods.provider(name) for name in _algorithms(trial.method)]
        entries.append(datasets.provider(trial.dataset.get("source")))
    except (MethodError, DatasetError):  # a broken module of this project, which the trial itself reports
        return ""
    return ", ".join(sorted({described(package_of(entry), top_of(entry)) for entry in entries if entry}))


@cache
def described(package: str, top: str) -> str:
    """Name, version and source digest of a package with the top-level module ``top``; computed once per process."""
    try:
        release = version(package)
    except PackageNotFoundError:
        release = "?"
    spec = find_spec(top) if top.isidentifier() else None
    source = digest_of(Path(spec.origin)) if spec and spec.origin and Path(spec.origin).is_file() else "?"
    return f"{package} {release} {source}"


def _algorithms(method: Mapping[str, Any]) -> Iterator[str]:
    """Names of the algorithms of a method and of its parts."""
    for key, value in method.items():
        if isinstance(value, Mapping):
            yield from _algorithms(value)
        elif key == "algorithm":
            yield str(value)
