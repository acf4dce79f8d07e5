"""The verb ``completion``: print a shell's completion script; the words at each tab come from argcomplete.

Overrides are completed by Hydra's own engine, see :mod:`nrsfm.harness.cli.overrides`.
"""

from __future__ import annotations

import os
import re
from argparse import Action, Namespace, _SubParsersAction
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import argcomplete
from argcomplete.completers import FilesCompleter

from nrsfm.harness.cli.parser import Parser, adding
from nrsfm.harness.cli.verbs import VERBS, module

SHELLS = ("bash", "zsh", "fish")
BEFORE = r"^(.*[;&|])?\s*(\w+=\S*\s+)*(?=\S*nrsfm\s)"  # other commands and variables before the command
COMPINIT = "(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }"


def main(argv: Sequence[str]) -> int:
    """Print the completion script of a shell."""
    shell = command_line().read(argv).shell
    first, rest = argcomplete.shellcode(["nrsfm"], use_defaults=False, shell=shell).split("\n", 1)
    print("\n".join([first, *([COMPINIT] if shell == "zsh" else []), rest]))
    return 0


class Finder(argcomplete.CompletionFinder):  # type: ignore[misc]  # argcomplete is checked as untyped
    """Words that may stand at the cursor of the command line in ``COMP_LINE``, each with its explanation."""

    def answer(self, **options: Any) -> None:
        """Write the words to the shell that asks, and exit."""
        line = os.environ["COMP_LINE"][: int(os.environ["COMP_POINT"])]
        line = re.sub(BEFORE, "", line, count=1)
        os.environ |= {"COMP_LINE": line, "COMP_POINT": str(len(line))}
        self(_all_verbs(), always_complete_options=False, **options)

    def collect_completions(self, active_parsers: list[Parser], parsed_args: Namespace, cword_prefix: str) -> list[str]:
        parser = active_parsers[-1]
        for action in parser._actions:
            if not isinstance(action, _SubParsersAction):
                action.completer = FilesCompleter() if action.type is Path else _words  # type: ignore[attr-defined]
        active: list[Action] = parser.active_actions  # type: ignore[attr-defined]  # set by argcomplete
        if all(action.option_strings for action in active):  # options may stand between words
            active += [action for action in parser._actions if action.nargs == "*"]
        words: list[str] = super().collect_completions(active_parsers, parsed_args, cword_prefix)
        return words


def _all_verbs() -> Parser:
    """A parser with a subparser for each verb, complete for the verbs that the line contains."""
    parser = Parser("nrsfm")
    parser.add_argument("--version", action="store_true", help="print the version")
    verbs = parser.add_subparsers()
    for verb, (_, text) in VERBS.items():
        verbs.add_parser(verb, help=text)
        if verb in os.environ["COMP_LINE"].split():
            verbs.choices[verb] = module(verb).command_line()
    return parser


def _words(prefix: str, action: Action, parser: Parser, parsed_args: Namespace, **_: object) -> Mapping[str, str]:
    """The words that an argument takes."""
    words = parser.offers.get(action.dest, lambda: dict.fromkeys(map(str, action.choices or ()), ""))()
    if action.dest != parser.overrides:
        return words
    from nrsfm.harness.cli.overrides import complete  # loads Hydra

    before = argcomplete.split_line(os.environ["COMP_LINE"])[3]
    given = [word for word in before if "=" in word or word.startswith("~")]
    folder: Path | None = getattr(parsed_args, "config_dir", None)
    overrides = complete([*given, *([adding(folder)] if folder else [])], prefix)
    return {**words, **{word: text for word, text in overrides.items() if word.startswith(parser.only)}}


def command_line() -> Parser:
    parser = Parser(
        "nrsfm completion",
        "Print a shell's completion of verbs, options, configuration groups, their choices, and keys.",
        """\
eval "$(nrsfm completion bash)"  # this shell; in ~/.bashrc every shell
eval "$(nrsfm completion zsh)"  # in ~/.zshrc, too
nrsfm completion fish | source  # in ~/.config/fish/config.fish, too""",
        "What installed packages bring is completed as well. Try: nrsfm run method=<TAB>",
    )
    parser.add_argument("shell", choices=SHELLS, help="the shell that is to complete")
    return parser
