"""Every verb explains itself by commands that work."""

from __future__ import annotations

import argparse
import re
import shlex
from pathlib import Path

import pytest
from hydra._internal.utils import get_args_parser

from nrsfm.harness.cli.completion import SHELLS
from nrsfm.harness.cli.parser import Parser
from nrsfm.harness.cli.verbs import VERBS, module, usage
from nrsfm.harness.config.compose import compose_config
from nrsfm.harness.config.settings import read
from nrsfm.harness.config.spans import spanned
from tests.shell import Shell

EXAMPLES = [(verb, line) for verb in VERBS for line in module(verb).command_line().examples]


def commands(line: str) -> list[list[str]]:
    """The words of each nrsfm command in a line of shell."""
    code = line.partition("  # ")[0]
    return [shlex.split(found) for found in re.findall(r"(?<![\w/])nrsfm ((?:'[^']*'|[^|>)'])*)", code)]


def parsers(parser: Parser) -> list[Parser]:
    """A verb's parser, and those of its own verbs."""
    below = [a.choices.values() for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return [parser, *(each for group in below for each in group)]


def test_every_verb_has_a_parser_and_a_line_of_the_usage() -> None:
    for verb in VERBS:
        assert re.search(rf"^  {verb}\b", usage(), re.MULTILINE), verb


@pytest.mark.parametrize("verb", VERBS)
def test_help_teaches(nrsfm: Shell, verb: str) -> None:
    for words in ([verb, "--help"], [verb, "-h"]):
        done = nrsfm(*words, COLUMNS="100")
        assert done.returncode == 0
        assert done.stdout.startswith(f"usage: nrsfm {verb}")
        assert done.stdout.count(f"  nrsfm {verb}") >= 1
    assert len(module(verb).command_line().examples) >= 3
    assert all(len(line) <= 115 for line in done.stdout.splitlines())
    for parser in parsers(module(verb).command_line()):
        assert all(action.help for action in parser._actions if not isinstance(action, argparse._SubParsersAction)), (
            parser.prog
        )


@pytest.mark.parametrize(("verb", "line"), EXAMPLES)
def test_examples_parse(verb: str, line: str, nrsfm: Shell, tmp_path: Path) -> None:
    """What Hydra is given is composed, what a parser is given is parsed, and what is quick is run."""
    found = commands(line)
    assert found, line
    for words in found:
        assert words[0] == verb
        parser = module(verb).command_line()
        given = parser.read(words[1:])
        if parser.overrides:
            named = [word for word in getattr(given, parser.overrides) if "=" not in word]
            overrides = [word for word in getattr(given, parser.overrides) if "=" in word]
            assert named == [] or verb == "report"
            for experiment in named or [None]:
                jobs = spanned([*([f"experiment={experiment}"] if experiment else []), *overrides])
                assert read(compose_config(jobs[-1]))
        if verb in ("list", "completion", "new") or words[:2] in (["data", "list"], ["data", "where"]):
            assert nrsfm(*words).returncode == 0


def test_run_names_hydras_options_alone_and_its_help(nrsfm: Shell) -> None:
    known = {flag for action in get_args_parser()._actions for flag in action.option_strings}
    ours = {flag for action in module("run").command_line()._actions for flag in action.option_strings}
    assert ours <= known
    assert "--hydra-help" in nrsfm("run", "--help").stdout
    assert "powered by Hydra" not in nrsfm("run", "--help").stdout
    assert "--multirun" in nrsfm("run", "--hydra-help").stdout


def test_a_config_dir_is_for_run(nrsfm: Shell, tmp_path: Path) -> None:
    (tmp_path / "own/method").mkdir(parents=True)
    (tmp_path / "own/method/mine.yaml").write_text("defaults: [edsc, _self_]\nname: mine\n")
    done = nrsfm("run", "--config-dir", str(tmp_path / "own"), "--cfg", "job", "method=mine", "--package", "method")
    assert "name: mine" in done.stdout


def test_bad_options_of_every_verb_are_one_line(nrsfm: Shell) -> None:
    for verb in VERBS:
        done = nrsfm(verb, "--bogus")
        assert done.returncode == 3, verb
        (line,) = done.stderr.splitlines()
        assert f"nrsfm {verb}" in line and f"nrsfm {verb} --help" in line


def test_shells_are_those_of_the_usage() -> None:
    assert "|".join(SHELLS) in usage()
