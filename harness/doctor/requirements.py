"""What this package needs, by its metadata: what is there, and what is not. Loads none of it."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata

from packaging.requirements import InvalidRequirement, Requirement

OK, NOTE, PROBLEM = "ok", "note", "problem"
PROJECT = "nrsfm"

#: What each extra is for; those of the project's own development are left out.
EXTRAS = {
    "slurm": "hydra/launcher=submitit_slurm and submitit_local",
    "ray": "hydra/launcher=ray",
    "server": "an MLflow server of your own: logins, PostgreSQL",
    "umpm": "C3D files: dataset=umpm, dataset=c3d",
    "mat73": "MATLAB files of version 7.3",
}


@dataclass(frozen=True)
class Finding:
    """One line: what it is about, ``ok``, ``note`` or ``problem``, what was found, and the remedy where one is due."""

    topic: str
    state: str
    text: str
    remedy: str = ""


def versions() -> Iterator[Finding]:
    """Python, this package, and every library that it needs."""
    yield Finding("python", OK, f"{platform.python_version()}, {platform.system()} {platform.machine()}")
    wrong = [(need, reason) for need in _needs() if (reason := _unmet(need))]
    for need, reason in wrong:
        yield Finding("libraries", PROBLEM, reason, f"pip install '{need.name}{need.specifier}'")
    names = ("numpy", "scipy", "scikit-learn", "mlflow", "hydra-core")
    there = [f"{name} {_version(name)}" for name in (PROJECT, *names) if _version(name)]
    if not wrong:
        yield Finding("libraries", OK, ", ".join(there))


def extras() -> Iterator[Finding]:
    """The optional parts, there or not."""
    for extra, purpose in EXTRAS.items():
        needs = [need for need in _needs(extra) if need not in _needs()]
        reasons = [reason for need in needs if (reason := _unmet(need))]
        if reasons:
            remedy = f"pip install '{PROJECT}[{extra}]'"
            yield Finding("extras", NOTE, f"{extra} ({purpose}): {', '.join(reasons)}", remedy)
        else:
            there = ", ".join(f"{need.name} {_version(need.name)}" for need in needs)
            yield Finding("extras", OK, f"{extra} ({purpose}): {there}")


def _needs(extra: str = "") -> list[Requirement]:
    """What this package's metadata ask for, with an extra or without; nothing where it is not installed."""
    try:
        needs = [Requirement(text) for text in metadata.requires(PROJECT) or ()]
    except (metadata.PackageNotFoundError, InvalidRequirement):
        return []
    return [need for need in needs if need.marker is None or need.marker.evaluate({"extra": extra})]


def _unmet(need: Requirement) -> str:
    """Why a requirement is not met; "" when it is."""
    found = _version(need.name)
    if not found:
        return f"{need.name} is not installed"
    if need.specifier.contains(found, prereleases=True):
        return ""
    return f"{need.name} is {found}, wanted {need.specifier}"


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""


def plural(word: str, n: int) -> str:
    return word if n == 1 else f"{word[:-1]}ies" if word.endswith("y") else f"{word}s"
