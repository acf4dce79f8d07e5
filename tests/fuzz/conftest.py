"""Number of files that each reader was tried on, printed at the end."""

from __future__ import annotations

from collections import Counter

import pytest

#: Files by reader and whether they were refused.
COUNTS: Counter[tuple[str, bool]] = Counter()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if COUNTS:
        terminalreporter.section("files tried")
        for name in dict.fromkeys(name for name, _ in COUNTS):
            read, not_read = COUNTS[name, False], COUNTS[name, True]
            terminalreporter.write_line(f"{name:<16} {read + not_read} files, {not_read} refused")
        terminalreporter.write_line(f"{'all':<16} {COUNTS.total()} files")
