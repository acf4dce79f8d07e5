"""How much memory a stranger's file may ask for: a little whatever it is, more in proportion to its size."""

from __future__ import annotations

from pathlib import Path

HUGE = 1e100  # no coordinate is as large; squares of larger ones are infinite


LARGEST = 2**31  # bytes of all arrays that are taken from one file


SMALL = 2**26  # bytes that any file may ask for


RATIO = 100  # bytes for each byte of the file; compressed tracks take a tenth of their size, not a hundredth


def allowance(path: Path) -> int:
    """Bytes that the arrays of a file may take, all together."""
    return min(LARGEST, max(SMALL, RATIO * path.stat().st_size))


def reason(error: Exception) -> str:
    """What an error says, in one line of 200 characters that print; its kind where it says nothing."""
    text = "".join(c if c.isprintable() else " " for c in str(error))
    return " ".join(text.split())[:200] or type(error).__name__


def claim(size: int) -> str:
    """What is said of an array that asks for more."""
    amount = f"{size / 2**30:.0f} GiB" if size >= 2**30 else f"{size / 2**20:.0f} MiB"
    return f"claims {amount}, more than a file of this size may; it is damaged or hostile"
