"""Where the real sequences are, for the tests that need them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_folder() -> Path:
    named = os.environ.get("NRSFM_DATA")
    if not named:
        pytest.skip("NRSFM_DATA is not set, so the real sequences are not known")
    return Path(named)
