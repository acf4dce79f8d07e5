"""The identity of a trial, computed once before a sweep and carried to what runs it; and the packages that it needs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from nrsfm.datasets import registry as datasets
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.harness.config.plugins import package_of, top_of
from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.environment import digest_of
from nrsfm.harness.record.parameters import flatten
from nrsfm.harness.record.trial import Trial
from nrsfm.methods import registry as methods
from nrsfm.methods.base import MethodError


@dataclass(frozen=True)
class Identity:
    """Key of a trial, which names its folder, and digest of its data, "" where they cannot be read."""

    key: str
    data: str = ""
    #: Why the trial cannot run, in one line; "" when it can.
    reason: str = ""
    #: Whether the reason is that the data are missing.
    absent: bool = False


def identify(trial: Trial, settings: Settings) -> Identity:
    """Compute a trial's identity from its configuration, its data and the version of its method."""
    try:
        data = datasets.digest(trial.dataset, settings.data, settings.missing == "stand_in")
        method = methods.build_method({k: v for k, v in trial.method.items() if k != "name"})
    except (DatasetError, MethodError) as error:
        key = trial.key("unavailable", str(error))
        return Identity(key, reason=str(error), absent=isinstance(error, MissingData))
    return Identity(trial.key(data, methods.version(method)), data)


def packages_of(trial: Trial) -> str:
    """The packages that bring a trial's method and scene, as ``nrsfm-example 0.1.0 3f2a91c0d4e5b678``; "" for none.

    The digest tells sources apart even if their version was not raised.
    """
    try:
        settings = flatten({"method": trial.method}).items()
        entries = [methods.provider(str(name)) for key, name in settings if key.endswith(".algorithm")]
        entries.append(datasets.provider(trial.dataset.get("source")))
    except (MethodError, DatasetError):  # a broken module of this project, which the trial itself reports
        return ""
    return ", ".join(sorted({described(package_of(entry), top_of(entry)) for entry in entries if entry}))


@cache
def described(package: str, top: str) -> str:
    """Name, version and source digest of a package with the top-level module ``top``; computed once per process."""
    try:
        release = metadata.version(package)
    except metadata.PackageNotFoundError:
        release = "?"
    spec = find_spec(top) if top.isidentifier() else None
    source = digest_of(Path(spec.origin)) if spec and spec.origin and Path(spec.origin).is_file() else "?"
    return f"{package} {release} {source}"
