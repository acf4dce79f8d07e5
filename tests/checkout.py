"""Copies of this checkout, for tests that build, install or change one."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from tests.shell import ROOT

#: The folders that ``src/nrsfm`` links to, and those beside them.
PACKAGES = ("conf", "datasets", "harness", "methods", "reports")
BESIDE = ("docs", "examples", "tests")
FILES = (
    "CHANGELOG.md",
    "CITATION.cff",
    "CONTRIBUTING.md",
    "LICENSE",
    "MANIFEST.in",
    "Makefile",
    "README.md",
    "constraints.txt",
    "pyproject.toml",
)
IGNORED = shutil.ignore_patterns("__pycache__", ".*", "*.egg-info", "_build")


def copy_checkout(target: Path) -> Path:
    """Copy the sources, the documents and the tests to a new folder, links as links; returns the folder."""
    for folder in ("src", *PACKAGES, *BESIDE):
        shutil.copytree(ROOT / folder, target / folder, symlinks=True, ignore=IGNORED)
    for name in FILES:
        shutil.copy(ROOT / name, target / name)
    return target


def contents(root: Path, *folders: str) -> set[str]:
    """Paths of the files in folders of ``root``, those behind links included, byte code excluded."""
    files = set()
    for folder in folders:
        for place, inner, names in os.walk(root / folder, followlinks=True):
            inner[:] = [name for name in inner if name != "__pycache__"]
            files |= {(Path(place) / name).relative_to(root).as_posix() for name in names}
    return files
