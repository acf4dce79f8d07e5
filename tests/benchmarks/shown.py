"""Printing of a benchmark's table."""

from __future__ import annotations

import os

import pytest
from rich.console import Console
from rich.table import Table


def show(capsys: pytest.CaptureFixture[str], table: Table, note: str) -> None:
    """Print a table past pytest's capture, and a line with the machine's cores and load."""
    with capsys.disabled():
        console = Console(width=110)
        console.print()
        console.print(table)
        console.print(f"{note}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}", highlight=False)
