"""Limits on what a file from a stranger may hold: bytes of memory, and the size of a number."""

from __future__ import annotations

from pathlib import Path

HUGE = 1e100  # no coordinate is as large; squares of larger ones are infinite
LARGEST = 2**31  # bytes of all arrays that are read from one file
SMALL = 2**26  # bytes that the arrays of any file may take
RATIO = 100  # bytes of memory for each byte of the file; compressed tracks take a tenth of their size


def allowance(path: Path) -> int:
    """Bytes of memory that all arrays of a file may take together, from the size of the file."""
    return min(LARGEST, max(SMALL, RATIO * path.stat().st_size))


def claim(size: int) -> str:
    """The complaint about an array that claims ``size`` bytes, more than are allowed."""
    amount = f"{size / 2**30:.0f} GiB" if size >= 2**30 else f"{size / 2**20:.0f} MiB"
    return f"claims {amount}, more than a file of this size may; it is damaged or hostile"


def reason(error: Exception) -> str:
    """An error's message in one printable line of at most 200 characters; its type if it has no message."""
    text = "".join(c if c.isprintable() else " " for c in str(error))
    return " ".join(text.split())[:200] or type(error).__name__
