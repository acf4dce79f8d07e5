"""Every flag of Hydra on 'nrsfm run' works or is refused in one line, alone and with overrides, good and bad."""

from __future__ import annotations

from pathlib import Path

import pytest
from hydra._internal.utils import get_args_parser

from nrsfm.harness.cli.run import INFO, command_line
from tests.shell import Shell

SHOWN = [
    *(["--cfg", kind] for kind in ("job", "hydra", "all")),
    ["--cfg", "job", "--resolve"],
    ["--cfg", "job", "--package", "method"],
    *(["--info", part] for part in INFO),
    ["--info"],
    ["--hydra-help"],
    ["--version"],
]
GOOD = [[], ["method=edsc"], ["experiment=table1"]]
BAD = [["noise=1"], ["dataset=["], ["method=nope"], ["nonsense=1"], ["+experiment=table1"]]


def test_every_flag_of_hydra_is_known() -> None:
    flags = {flag for action in get_args_parser()._actions for flag in action.option_strings}
    assert flags == {flag for action in command_line()._actions for flag in action.option_strings}


@pytest.mark.parametrize("flags", SHOWN, ids=" ".join)
def test_what_is_shown(nrsfm: Shell, flags: list[str], tmp_path: Path) -> None:
    for overrides in GOOD:
        done = nrsfm("run", *overrides, *flags)
        assert done.returncode == 0, (overrides, done.stderr)
        assert done.stdout and not done.stderr, overrides
    for overrides in BAD:
        done = nrsfm("run", *overrides, *flags)
        lines = done.stderr.splitlines()
        assert (done.returncode, len(lines)) in {(3, 1), (0, 0)}, (overrides, lines)
        assert done.returncode == 3 or flags[0] in ("--hydra-help", "--version", "--info"), overrides
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--cfg", "nope"], "invalid choice: 'nope'"),
        (["--cfg"], "expected one argument"),
        (["--info", "nope"], "invalid choice: 'nope'"),
        (["--cfg", "job", "--package", "nope"], "package 'nope' not found"),
        (["--package", "method"], "--package is for --cfg"),
        (["--resolve"], "--resolve is for --cfg"),
        (["--hydra-help", "--resolve"], "--resolve is for --cfg"),
        (["--cfg", "job", "--info", "all"], "--cfg and --info show different things"),
        (["--cfg", "job", "--hydra-help"], "--cfg and --hydra-help show different things"),
        (["-m", "--cfg", "job"], "--cfg and --info show one"),
        (["--config-name", "x"], "there is one configuration"),
        (["--config-path", "/etc"], "there is one configuration"),
        (["--config-dir", "/nonexistent"], "there is no such folder"),
        (["--config-dir", "/nonexistent", "--cfg", "job"], "there is no such folder"),
        (["--experimental-rerun", "job.pickle"], "rerun=all"),
        (["--shell-completion", "install=bash"], "nrsfm completion bash"),
        (["--run", "--multirun"], "give one of them"),
        (["--run", "noise.level=0,0.1"], "the overrides span 2"),
        (["experiment=table1,table2"], "names several experiments"),
        (["+experiment=table1"], "replace it with experiment=NAME"),
        (["+dataset.colour=red"], "dataset.colour is unknown to procedural"),
        (["+limits.disk=1"], "limits.disk is unknown, limits has seconds, memory_gb, sweep_seconds"),
        (["~limits.seconds"], "limits.seconds is missing, wanted a positive number"),
        (["threads=1.5"], "threads is 1.5, wanted 1, 2, ..."),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_is_refused(nrsfm: Shell, tmp_path: Path, words: list[str], message: str) -> None:
    done = nrsfm("run", *words)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 3 and message in line
    assert not (tmp_path / "out").exists()
