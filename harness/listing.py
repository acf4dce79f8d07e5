"""The verb ``list``: what there is to choose from, one line each."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources

from rich.console import Console
from rich.table import Table

from harness.arguments import Parser

GROUPS = {"methods": "method", "datasets": "dataset", "experiments": "experiment"}


def choices(group: str) -> list[tuple[str, str]]:
    """Names of a configuration group with the first comment line of each file."""
    found = []
    for entry in resources.files("conf").joinpath(group).iterdir():
        if entry.name.endswith(".yaml"):
            comments = [line[1:].strip() for line in entry.read_text().splitlines() if line.startswith("# ")]
            comments = [c for c in comments if not c.startswith("@package")]
            found.append((entry.name.removesuffix(".yaml"), comments[0] if comments else ""))
    return sorted(found)


def main(argv: Sequence[str]) -> int:
    """Print one group, or all."""
    parser = Parser("harness list", description="Methods, datasets and experiments, one line each.")
    parser.add_argument("what", nargs="?", choices=list(GROUPS))
    given = parser.read(argv)
    console = Console()
    for heading in [given.what] if given.what else list(GROUPS):
        table = Table(box=None, pad_edge=False, show_header=False)
        table.add_column(style="bold", no_wrap=True)
        table.add_column()
        for name, line in choices(GROUPS[heading]):
            table.add_row(name, line)
        console.print(f"[bold]{heading}[/bold]")
        console.print(table)
    return 0
