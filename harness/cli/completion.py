"""The verb ``completion``: a script for the shell, and the answers that it asks for.

The script asks ``nrsfm completion --query LINE`` at every tab, LINE being what stands before the cursor. The answer
is a line for each word that may stand there, behind a tab what it is; or ``:files`` where a path is wanted. Overrides
are completed by Hydra's own engine, see :class:`hydra.plugins.completion_plugin.CompletionPlugin`.
"""

from __future__ import annotations

import shlex
from argparse import SUPPRESS, Action
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path

from nrsfm.harness.cli.parser import FILES, Parser
from nrsfm.harness.cli.verbs import VERBS, module

QUERY = "--query"


def main(argv: Sequence[str]) -> int:
    """Print a shell's script, or answer its question."""
    if argv[:1] == [QUERY]:
        found = candidates(argv[1] if len(argv) > 1 else "")
        print("\n".join(f"{word}\t{text}" if text else word for word, text in found.items()))
        return 0
    shell = command_line().read(argv).shell
    print((resources.files("nrsfm.harness.cli.shells") / f"nrsfm.{shell}").read_text(encoding="utf-8"), end="")
    return 0


def candidates(line: str) -> dict[str, str]:
    """The words that may stand at the end of a command line, each with what it is, in one line or "".

    ``{":files": ""}`` where a path is wanted.
    """
    *before, word = _words(line)
    if not before:
        offered = {verb: text for verb, (_, text) in VERBS.items()}
        if word.startswith("-"):
            offered = {"--help": "usage", "--version": "the version"}
        return _beginning(word, offered)
    if before[0] not in VERBS:
        return {}
    return _of_verb(module(before[0]).command_line(), before[1:], word)


def _of_verb(parser: Parser, before: Sequence[str], word: str) -> dict[str, str]:
    """What may stand behind a verb and its words before."""
    options = {flag: action for action in parser._actions for flag in action.option_strings}
    places = [action for action in parser._actions if not action.option_strings]
    words: list[str] = []
    value_of: Action | None = None
    for given in before:
        if value_of is not None:
            value_of = None
        elif given in options:
            value_of = options[given] if options[given].nargs != 0 else None
        elif not given.startswith("-"):
            words.append(given)
            verbs = places[0].choices if places and places[0].dest == "verb" else None
            if isinstance(verbs, Mapping) and given in verbs:
                return _of_verb(verbs[given], before[before.index(given) + 1 :], word)
    if value_of is not None:
        if value_of.type is Path:
            return {FILES: ""}
        offers = parser.offers.get(value_of.dest, lambda: dict.fromkeys(map(str, value_of.choices or ()), ""))
        return _beginning(word, offers())
    if word.startswith("-"):
        return _beginning(word, {flag: action.help or "" for flag, action in options.items() if len(flag) > 2})
    place = places[min(len(words), len(places) - 1)] if places else None
    if place is None or (len(words) >= len(places) and place.nargs != "*"):
        return {}
    if place.type is Path:
        return {FILES: ""}
    offered = {}
    if place.dest in parser.offers:
        offered = dict(parser.offers[place.dest]())
    elif place.choices is not None:
        told = {each.dest: each.help or "" for each in getattr(place, "_choices_actions", ())}
        offered = {str(choice): told.get(str(choice), "") for choice in place.choices}
    found = _beginning(word, offered)
    if place.dest == parser.overrides:
        from nrsfm.harness.cli.overrides import complete  # loads Hydra

        overrides = complete([given for given in words if "=" in given or given.startswith("~")], word)
        found |= {each: text for each, text in overrides.items() if each.startswith(parser.only)}
    return found


def _beginning(word: str, offered: Mapping[str, str]) -> dict[str, str]:
    begin = {name: "" if text is SUPPRESS else text for name, text in offered.items() if name.startswith(word)}
    return begin if FILES not in offered else {FILES: ""}


def _sentence(parser: Parser) -> str:
    return " ".join((parser.description or "").split()).partition(". ")[0].rstrip(".")


def _words(line: str) -> list[str]:
    """The words behind the command, the last one being under the cursor: "" behind a space."""
    for end in ("", "'", '"'):  # a quote may be open
        try:
            words = shlex.split(f"{line}.{end}")  # the full stop keeps an empty last word
            break
        except ValueError:
            continue
    else:
        words = f"{line}.".split()
    words[-1] = words[-1][:-1]
    start = next((i for i, each in enumerate(words[:-1]) if "=" not in each), 0)  # behind variables that are set
    return words[start + 1 :] or [""]


SHELLS = ("bash", "zsh", "fish")


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
