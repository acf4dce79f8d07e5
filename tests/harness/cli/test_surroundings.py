"""Terminals without the signs, long temporary paths, closed output, and errors that nobody expected."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from nrsfm.harness.cli import main as command
from nrsfm.harness.cli import verbs
from tests.shell import TINY, Shell


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_without_the_signs_gets_stand_ins_and_all_files(shell: Shell, tmp_path: Path, encoding: str) -> None:
    done = shell("report", "table1", PYTHONIOENCODING=encoding)
    assert done.returncode == 2 and "Traceback" not in done.stderr  # no trial has run
    assert "Table 1: 0 of 24 published numbers" in done.stdout
    assert (tmp_path / "out/report/index.html").stat().st_size > 1e5


def test_a_long_temporary_folder_is_replaced_by_a_short_one(shell: Shell, tmp_path: Path) -> None:
    long = tmp_path / ("x" * 100)
    long.mkdir()
    done = shell("run", *TINY, TMPDIR=str(long))
    assert done.returncode == 0, done.stderr


def test_closed_output_loses_no_file(shell: Shell, tmp_path: Path, environment: dict[str, str]) -> None:
    command = [sys.executable, "-m", "nrsfm", "report", "table1"]
    with subprocess.Popen(
        command, env=environment, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as child:
        assert child.stdout is not None
        child.stdout.close()
        child.wait(600)
    assert (tmp_path / "out/report/index.html").stat().st_size > 1e5


def test_an_unexpected_error_is_one_line_that_names_the_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Broken:
        @staticmethod
        def main(_: object) -> int:
            raise KeyError("no\nsuch\x1b[1m thing")

    monkeypatch.setattr(verbs, "module", lambda verb: Broken)
    assert command.main(["list"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("nrsfm list: unexpected KeyError: ") and "\x1b" not in line
    log = Path(line.partition("the traceback is in ")[2])
    assert "Broken" not in line and 'raise KeyError("no' in log.read_text()
    log.unlink()
