"""Fixtures that several suites share."""

from __future__ import annotations

import os
import shutil
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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if not os.environ.get("NRSFM_DATA"):
        absent = pytest.mark.skip(reason="NRSFM_DATA is not set, so the real sequences are not there")
        for item in items:
            if item.get_closest_marker("data"):
                item.add_marker(absent)
    programs = {"browser": (chromium(), "Chromium"), "tex": (shutil.which("pdflatex"), "pdflatex")}
    if any(item.get_closest_marker("postgres") for item in items):
        from tests.harness.tracking.servers import postgres_folder

        programs["postgres"] = (postgres_folder() and find_spec("psycopg"), "PostgreSQL, or the extra 'server',")
    for name, (found, wanted) in programs.items():
        for item in items:
            if not found and item.get_closest_marker(name):
                item.add_marker(pytest.mark.skip(reason=f"{wanted} is not installed"))


def chromium() -> str | None:
    """The system's Chromium, if there is one."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of the real sequences; for tests marked ``data``."""
    return Path(os.environ["NRSFM_DATA"])


@pytest.fixture(scope="session")
def small_scene() -> Scene:
    """Two generated bodies, small enough for slow references."""
    return procedural.load_scene(["person", "face"], 15, 30, 0, name="small", placement="paper")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
