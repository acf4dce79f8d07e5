"""YAML of others: aliases that multiply without end are refused, others are not."""

from __future__ import annotations

from pathlib import Path

import pytest

from nrsfm.harness.config.aliases import MOST, check_file
from nrsfm.harness.record.errors import UsageError
from tests.shell import Shell


def bomb(levels: int) -> str:
    """A list of ten lists of ten lists ..., in a line a level."""
    lines = ["a0: &a0 [x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, levels + 1)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("text", [bomb(5), bomb(40), "a: &a [*a]", "a: &a {b: *a}", "x: &x\n- *x\n"])
def test_aliases_that_multiply_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(UsageError, match=f"mine.yaml: its aliases make more than {MOST} values of it"):
        check_file(tmp_path / "mine.yaml")


@pytest.mark.parametrize("text", [bomb(4), "glob: '*.mat'\n", "a: &a 1\nb: *a\n", "- *unknown\n", "a: [*", ""])
def test_others_are_left_to_hydra(tmp_path: Path, text: str) -> None:
    (tmp_path / "mine.yaml").write_text(text)
    check_file(tmp_path / "mine.yaml")


def test_a_size_is_bounded(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("# " + "x" * (1 << 20))
    with pytest.raises(UsageError, match="larger than 1 MiB"):
        check_file(tmp_path / "mine.yaml")


def test_every_verb_refuses_it_at_once(nrsfm: Shell, tmp_path: Path) -> None:
    (tmp_path / "own/method").mkdir(parents=True)
    (tmp_path / "own/method/mine.yaml").write_text(bomb(40) + "name: mine\n")
    for verb in ("run", "plan", "compare", "sync"):
        done = nrsfm(verb, "--config-dir", "own", "method=mine")
        assert done.returncode == 3
        (line,) = done.stderr.splitlines()
        assert "mine.yaml: its aliases make" in line
