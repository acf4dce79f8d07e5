"""What a number was computed with."""

from __future__ import annotations

import functools
import hashlib
import os
import platform
from importlib import metadata
from pathlib import Path

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)

#: What of the environment results are computed by; a record that differs in one of them is stale.
COMPUTES = ("code", "numpy", "scipy", "scikit-learn", "blas")


@functools.cache
def environment() -> dict[str, str]:
    """Versions of Python, the numerical libraries and this project, the BLAS, the machine, the methods' source."""
    from threadpoolctl import threadpool_info

    versions = {name: metadata.version(name) for name in ("numpy", "scipy", "scikit-learn", "nrsfm-harness")}
    blas = sorted({f"{p['internal_api']} {p['version']}" for p in threadpool_info() if p["user_api"] == "blas"})
    return {
        "python": platform.python_version(),
        **versions,
        "blas": ", ".join(blas),
        "machine": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "code": source_digest(),
    }


def checkout() -> Path | None:
    """The folder of the sources where the harness runs from a checkout; None where it is an installed package."""
    root = Path(__file__).parents[1]
    return root if (root / "pyproject.toml").is_file() else None


def cores() -> int:
    """Of this machine, those that this process may use."""
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


@functools.cache
def source_digest() -> str:
    """SHA-256 over the sources of datasets and methods, 16 hex digits."""
    import datasets
    import methods

    total = hashlib.sha256()
    for package in (datasets, methods):
        for path in sorted(Path(str(package.__file__)).parent.glob("*.py")):
            total.update(path.name.encode() + b"\0" + path.read_bytes())
    return total.hexdigest()[:16]
