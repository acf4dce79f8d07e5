"""Fixtures of the tests of real sequences, which write many small MATLAB files."""

from __future__ import annotations

import pytest

from nrsfm.datasets.readers import matfile


@pytest.fixture
def guarded() -> None:
    """Asked for by tests of damaged files, which are to be read in the guarded process."""


@pytest.fixture(autouse=True)
def read_here(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Read files of versions 4 and 5 as if they were the catalogue's: a process for each would take minutes."""
    if "guarded" not in request.fixturenames:
        monkeypatch.setattr(matfile, "_is_known", lambda path: matfile._kind(path) == "mat")
