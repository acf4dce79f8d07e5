"""The parser of every verb: an error is one line and exit code 3, options and words come in any order."""

from __future__ import annotations

import argparse
import shutil
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.text import printable

#: Gives the words that complete an argument, each with an explanation.
Words = Callable[[], Mapping[str, str]]


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are one line and exit code 3, and whose help ends in commands that work.

    Parameters
    ----------
    prog : str
        ``nrsfm VERB``.
    description : str
        What the verb does; its first sentence stands alone in a shell's completion.
    examples : str
        Commands, one a line, each with a comment.
    notes : str
        Printed below them: exit codes, where to read on.
    """

    def __init__(self, prog: str, description: str = "", examples: str = "", notes: str = "", **more: Any) -> None:
        self.examples = examples.splitlines()
        self.offers: dict[str, Words] = {}
        self.overrides = ""
        self.only: tuple[str, ...] = ("",)
        shown = ["examples:", *_aligned(self.examples)] if self.examples else []
        super().__init__(
            prog,
            description=textwrap.fill(description, min(shutil.get_terminal_size().columns, 102) - 2),
            epilog="\n\n".join(filter(None, ["\n".join(shown), notes])),
            formatter_class=argparse.RawDescriptionHelpFormatter,
            **more,
        )

    def add_words(self, name: str, offers: Words, **more: Any) -> None:
        """Add an argument or an option that a shell completes with the words of ``offers``."""
        self.offers[self.add_argument(name, **more).dest] = offers

    def add_overrides(
        self, name: str = "overrides", metavar: str = "OVERRIDE", more: str = "", only: tuple[str, ...] = ("",)
    ) -> None:
        """Add Hydra overrides, completed with those that begin as ``only`` says; ``name`` may take other words too."""
        text = f"a choice (method=adaptive) or a value (noise.level=0.02) as for 'nrsfm run'{more}"
        self.add_argument(name, nargs="*", metavar=metavar, help=text)
        text = "add the files of a tree like conf/, as hydra.searchpath does"
        self.add_argument("-cd", "--config-dir", type=Path, metavar="FOLDER", help=text)
        self.overrides, self.only = name, only

    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {printable(message)}; see '{self.prog} --help'", file=sys.stderr)
        raise SystemExit(3)

    def read(self, argv: Sequence[str]) -> argparse.Namespace:
        """Parse, with options and words in any order; UsageError if an override names a choice that does not exist."""
        if self._subparsers is not None:  # argparse mixes no words into those
            return self.parse_args(list(argv))
        options = self.parse_intermixed_args(list(argv))
        if self.overrides:
            from nrsfm.harness.config.plugins import check_choices

            words = getattr(options, self.overrides)
            if options.config_dir is not None:
                if any(word.startswith("hydra.searchpath=") for word in words):
                    raise UsageError("--config-dir is hydra.searchpath for one folder; name all in hydra.searchpath")
                words.append(adding(options.config_dir))
            check_choices(words)
        return options


def adding(folder: Path) -> str:
    """The override that adds a folder of configurations; UsageError if there is none."""
    if not folder.is_dir():
        raise UsageError(f"--config-dir {folder}: there is no such folder")
    from nrsfm.harness.config.compose import quoted

    return f"hydra.searchpath=[{quoted(f'file://{folder.resolve()}')}]"


def _aligned(examples: Sequence[str], longest: int = 56) -> list[str]:
    """Commands with their comments in a column, below the command where it is long."""
    parts = [(command, note) for command, _, note in (line.partition("  # ") for line in examples)]
    width = max((len(command) for command, note in parts if note and len(command) <= longest), default=0)
    lines = []
    for command, note in parts:
        lines.append(f"  {command:{width}}  # {note}" if note and len(command) <= longest else f"  {command}")
        if note and len(command) > longest:
            lines.append(f"  {'':{width}}  # {note}")
    return lines


def group_choices(group: str) -> Words:
    """Completes the choices of a configuration group."""

    def offers() -> Mapping[str, str]:
        from nrsfm.harness.config.plugins import choices

        return {name: line for name, (line, _) in choices(group).items()}

    return offers
