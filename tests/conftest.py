"""Shared fixtures, skips of tests whose programs or data are missing, and a summary of the skips."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):  # before numpy loads
    os.environ.setdefault(_variable, "1")

import numpy as np
import pytest

from nrsfm.datasets.generated import procedural
from nrsfm.datasets.scene import Scene

pytest_plugins = ("tests.shell",)

PAIRS = (
    "dance_yoga",
    "drink_walking",
    "shark_stretch",
    "walking_yoga",
    "face_pickup",
    "face_yoga",
    "shark_yoga",
    "stretch_yoga",
)


#: What a marker needs and how to get it.
NEEDS = {
    "data": "the real sequences: `nrsfm data get`, then NRSFM_DATA=<their folder>",
    "browser": "Chromium (Debian: apt-get install chromium)",
    "tex": "pdflatex with booktabs, longtable and multirow (`make validate` installs it)",
    "postgres": "PostgreSQL and the extra `server` (`make test-server` installs both)",
}
#: A part of a skip's reason, and the line that stands for all such skips at the end of a run.
GROUPS = {
    "garg": "the dense sequences of Garg et al., which their authors give out on request",
    "umpm": "the UMPM sequences, which need a login",
    "ray": "Ray (the extra `ray`)",
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests whose marker names a program or files that this machine lacks.

    scikit-learn's checks of array libraries need SCIPY_ARRAY_API, which scipy reads when it is imported:
    tests/methods/clustering/test_array_libraries.py runs them in a process that has it.
    """
    if "SCIPY_ARRAY_API" not in os.environ:
        items[:] = [item for item in items if "check_array_api_input" not in item.name]
    present = {
        "data": lambda: bool(os.environ.get("NRSFM_DATA")),
        "browser": lambda: chromium() is not None,
        "tex": lambda: shutil.which("pdflatex") is not None,
        "postgres": _postgres,
    }
    for name, check in present.items():
        marked = [item for item in items if item.get_closest_marker(name)]
        if marked and not check():
            for item in marked:
                item.add_marker(pytest.mark.skip(reason=f"needs {NEEDS[name]}"))


def _postgres() -> bool:
    from tests.harness.tracking.servers import postgres_folder

    return postgres_folder() is not None and find_spec("psycopg") is not None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say in the last lines which tests were skipped and why, one line a reason."""
    counts: Counter[str] = Counter()
    for report in terminalreporter.stats.get("skipped", []):
        reason = str(report.longrepr[2]).removeprefix("Skipped: ") if isinstance(report.longrepr, tuple) else "?"
        counts[skipped_for(reason)] += 1
    for reason, count in counts.most_common():
        terminalreporter.write_line(f"skipped {count:4} tests: {reason}")


def skipped_for(reason: str) -> str:
    """The line for a skip's reason: that of its group, else the reason itself."""
    words = reason.lower().replace("/", " ").split()
    return next((f"needs {text}" for part, text in GROUPS.items() if part in words), reason)


def chromium() -> str | None:
    """Path of the system's Chromium, or None."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of the real sequences, for tests marked ``data``."""
    return Path(os.environ["NRSFM_DATA"])


@pytest.fixture(scope="session")
def small_scene() -> Scene:
    """Two generated bodies, small enough for slow references."""
    return procedural.load_scene(["person", "face"], 15, 30, 0, name="small", placement="paper")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
