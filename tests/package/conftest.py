"""Distributions that the tests of the package share."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.checkout import copy_checkout


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``sources``, a copy of the checkout, the sdist made of it, and the wheel made of the sdist."""
    pytest.importorskip("build")
    folder = tmp_path_factory.mktemp("built")
    source = folder / "sources"
    source.mkdir()
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(copy_checkout(source))]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    assert "Deprecat" not in done.stdout + done.stderr
    return folder
