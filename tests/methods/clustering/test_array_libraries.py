"""scikit-learn's checks of array libraries, which scipy answers only where it was imported with SCIPY_ARRAY_API."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def test_scikit_learn_checks_of_array_libraries() -> None:
    words = ("-q", "-n0", "-p", "no:cacheprovider", "-k", "check_array_api_input")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words, str(Path(__file__).with_name("test_clustering.py"))],
        env=os.environ | {"SCIPY_ARRAY_API": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert "skipped" not in done.stdout
