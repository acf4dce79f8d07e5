"""Terminals without the signs, long temporary paths, closed output, and errors that nobody expected."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
import pytest

from nrsfm.harness.cli import main as command
from nrsfm.harness.cli import verbs
from tests.shell import TINY, Shell, tracked


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


def test_a_user_without_a_home_runs_and_tracks(environment: dict[str, str], tmp_path: Path) -> None:
    """As in a container that is given a number for a user."""
    as_nobody = ["unshare", "--user", "--map-user=12345", "--map-group=12345"]
    if shutil.which("unshare") is None or subprocess.run([*as_nobody, "true"], check=False).returncode:
        pytest.skip("needs user namespaces: unshare --user")
    variables = {name: value for name, value in environment.items() if name not in ("HOME", "USER", "LOGNAME")}
    command = [*as_nobody, sys.executable, "-m", "nrsfm", "run", *TINY]
    done = subprocess.run(command, env=variables, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    assert len(tracked(tmp_path)) == 1


def test_main_works_in_a_thread(environment: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(tmp_path)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(command.main, ["run", *TINY, "noise.level=0,0.02"]).result() == 0
    assert len(tracked(tmp_path)) == 2


@pytest.mark.parametrize("told", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_what_a_command_started_ends_with_it(told: int, environment: dict[str, str], tmp_path: Path) -> None:
    """Here a shell with a child that does not want to end, as MLflow's server has workers."""
    code = (
        "import sys; from nrsfm.harness.cli.ui import _until_stopped\n"
        "sys.exit(_until_stopped(['sh', '-c', 'trap \"\" TERM; sleep 600 & echo $!; wait; sleep 600']))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code],
        env=environment,
        stdout=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:
        assert process.stdout is not None
        child = psutil.Process(int(process.stdout.readline()))
        process.send_signal(told)
        process.wait(600)
    assert not child.is_running() or child.status() == psutil.STATUS_ZOMBIE
