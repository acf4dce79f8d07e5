"""The verb ``list``: print methods, datasets and experiments, one line each."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from nrsfm.harness.cli.parser import Parser

GROUPS = {"methods": "method", "datasets": "dataset", "experiments": "experiment"}


def main(argv: Sequence[str]) -> int:
    """Print one group or all; faults of installed packages go to standard error."""
    options = command_line().read(argv)
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from nrsfm.harness.config.plugins import choices, faults
    from nrsfm.harness.record.text import printable

    console = Console()
    for heading in [options.what] if options.what else list(GROUPS):
        table = Table(box=None, pad_edge=False, show_header=False)
        table.add_column(style="bold", no_wrap=True)
        table.add_column()
        for name, (line, package) in choices(GROUPS[heading]).items():
            table.add_row(escape(printable(name)), escape(printable(f"{line} [{package}]" if package else line)))
        console.print(f"[bold]{heading}[/bold]")
        console.print(table)
    for fault in faults():
        print(f"nrsfm list: {printable(fault)}", file=sys.stderr)
    return 0


def command_line() -> Parser:
    parser = Parser(
        "nrsfm list",
        "List methods, datasets and experiments, one line each. Those of installed packages have the package's name.",
        "nrsfm list\nnrsfm list methods\nnrsfm list experiments",
        "Faults of installed packages go to standard error, one line each.",
    )
    parser.add_argument("what", nargs="?", choices=list(GROUPS), help="all, if left out")
    return parser
