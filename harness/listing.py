"""The verb ``list``: what there is to choose from, one line each."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from harness import parsers
from harness.extensions import choices, faults
from reports.text import printable

GROUPS = {"methods": "method", "datasets": "dataset", "experiments": "experiment"}


def main(argv: Sequence[str]) -> int:
    """Print one group, or all, and to standard error what is wrong with installed packages."""
    given = parsers.listing().read(argv)
    console = Console()
    for heading in [given.what] if given.what else list(GROUPS):
        table = Table(box=None, pad_edge=False, show_header=False)
        table.add_column(style="bold", no_wrap=True)
        table.add_column()
        for name, (line, package) in choices(GROUPS[heading]).items():
            table.add_row(escape(printable(name)), escape(printable(f"{line} [{package}]" if package else line)))
        console.print(f"[bold]{heading}[/bold]")
        console.print(table)
    for fault in faults():
        print(f"harness list: {printable(fault)}", file=sys.stderr)
    return 0
