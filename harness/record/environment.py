"""The environment of a trial: versions, sources, processor. It names no host, user or folder: records are shared."""

from __future__ import annotations

import functools
import hashlib
import os
import platform
import subprocess
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)

#: Environment fields that can change a result; a record that differs in one of them is stale.
COMPUTES = ("code", "packages", "numpy", "scipy", "scikit-learn", "blas")

#: Environment fields that can change a time besides those; times compare where all of both agree.
MACHINE = ("processor", "cores", "threads", "machine", "python")

#: Environment fields that change with every edit of the sources, whether or not results or times change.
STATE = ("code", "commit", "tree")

#: Folders of a checkout that can change a result; uncommitted changes in them make the tree ``changed``.
SOURCES = ("conf", "datasets", "harness", "methods")


@functools.cache
def environment() -> Mapping[str, str]:
    """The environment that all trials of this process share; ``commit`` and ``tree`` only in a checkout."""
    from threadpoolctl import threadpool_info

    from nrsfm import datasets, methods

    names = ("numpy", "scipy", "scikit-learn", "mlflow", "hydra-core", "nrsfm")
    blas = sorted({f"{p['internal_api']} {p['version']}" for p in threadpool_info() if p["user_api"] == "blas"})
    return {
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in names},
        "blas": ", ".join(blas),
        "machine": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "cores": str(cores()),
        "code": digest_of(Path(datasets.__file__), Path(methods.__file__)),  # the sources that can change a result
        **commit(checkout()),
    }


def checkout() -> Path | None:
    """The root of the checkout that the harness runs from, or None if it is an installed package."""
    root = Path(__file__).resolve().parents[2]
    return root if (root / "pyproject.toml").is_file() else None


def cores() -> int:
    """The number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor()


def digest_of(*places: Path) -> str:
    """SHA-256 over modules, an ``__init__.py`` standing for all modules of its package; 16 hex digits."""
    total = hashlib.sha256()
    for place in places:
        for file in sorted(place.parent.rglob("*.py")) if place.name == "__init__.py" else [place]:
            total.update(file.relative_to(place.parent).as_posix().encode() + b"\0" + file.read_bytes())
    return total.hexdigest()[:16]


def commit(root: Path | None) -> dict[str, str]:
    """``commit`` of a checkout, and its ``tree``: clean, or changed in :data:`SOURCES`; {} if ``root`` has no ``.git``.

    Neither the working folder nor a repository around an installed package counts.
    """
    if root is None or not (root / ".git").exists():
        return {}
    places = [name for name in SOURCES if (root / name).is_dir()]
    head = _git(root, "rev-parse", "--verify", "HEAD")
    changes = _git(root, "status", "--porcelain", "--", *places)
    if head is None or changes is None:
        return {}
    return {"commit": head, "tree": "changed" if changes else "clean"}


def _git(root: Path, *words: str) -> str | None:
    """The output of a git command, or None if git is not installed or fails."""
    plain = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}  # set in git's hooks
    command = ["git", "--no-optional-locks", "-C", str(root), *words]
    try:
        done = subprocess.run(command, env=plain, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
