"""Command-line parsing that every verb shares: one line for an error, exit code 3, options and words in any order."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import NoReturn

from reports.text import printable


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose epilog keeps its lines and whose errors are one line and exit code 3."""

    def __init__(self, prog: str, description: str, epilog: str = "") -> None:
        super().__init__(
            prog, description=description, epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter
        )

    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {printable(message)}; see '{self.prog} --help'", file=sys.stderr)
        raise SystemExit(3)

    def read(self, argv: Sequence[str]) -> argparse.Namespace:
        """Parse, with options and words in any order."""
        return self.parse_intermixed_args(list(argv))
