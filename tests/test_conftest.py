"""The last lines of a test run: which tests were skipped, and why."""

from __future__ import annotations

import pytest

from tests.conftest import NEEDS, skipped_for


@pytest.mark.parametrize(
    ("reason", "line"),
    [
        ("/data/garg/face1.mat is not there; its authors give it out on request", "Garg et al."),
        ("/data/garg/face3.mat is not there; its authors give it out on request", "Garg et al."),
        ("/data/umpm/p2_free_2.c3d is not there; ask for a login", "UMPM"),
        ("the ray extra is absent", "Ray"),
        (f"needs {NEEDS['browser']}", "apt-get install chromium"),
    ],
)
def test_reasons_are_grouped(reason: str, line: str) -> None:
    assert line in skipped_for(reason)
    assert "/data/" not in skipped_for(reason)


def test_any_other_reason_stays() -> None:
    assert skipped_for("fish is not installed") == "fish is not installed"
