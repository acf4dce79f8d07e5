"""The progress display, in terminals of any size and without one."""

from __future__ import annotations

import fcntl
import io
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from dataclasses import replace
from pathlib import Path

import pytest
from rich.cells import cell_len
from rich.console import Console
from rich.live import Live

from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.sweep.display import Display
from nrsfm.harness.tracking.tracker import Tracker
from nrsfm.harness.trial.progress import Step
from tests.shell import ODD, tracked

BLANK = Outcome("", "", "ok", "d", "adaptive", "known", "", "", 0.0, 0, seconds=2.0)


def trials(n: int, method: str = "ours_in_some_variant") -> dict[str, Trial]:
    name = "a_scene_of_a_long_name"
    noise = {"level": 0, "repeat": 0}
    return {f"k{i}": Trial({"name": f"{name}_{i}"}, {"name": method}, {"source": "known"}, noise) for i in range(n)}


def terminal(width: int, height: int = 24) -> tuple[Console, io.StringIO]:
    output = io.StringIO()
    return Console(file=output, force_terminal=True, width=width, height=height, color_system=None), output


def half_done(n: int, running: int, console: Console) -> Display:
    """The display of a sweep of which two trials have ended and some are running."""
    asked = trials(n)
    display = Display(asked, console, live=False)
    display.ended("k0", replace(BLANK, metrics={"e_3d": 0.03, "n_wrong": 2.0}, n_points=80), ran=True)
    display.ended("k1", replace(BLANK, status="failed", error="it diverged"), ran=True)
    step = Step("", "structure", 120, 6000, {"primal": 1e-3, "dual": 4e-2})
    display.update({f"k{i}": replace(step, title=asked[f"k{i}"].title) for i in range(2, 2 + running)})
    return display


def lines(n: int, running: int, width: int, height: int = 24) -> list[str]:
    """The live lines of such a sweep in a terminal of that size."""
    console, output = terminal(width, height)
    display = half_done(n, running, console)
    output.seek(0)
    output.truncate()
    console.print(display.picture)
    return output.getvalue().splitlines()


@pytest.mark.parametrize("width", [30, 60, 80, 100, 200])
def test_no_line_is_wider_than_the_terminal(width: int) -> None:
    drawn = lines(9, 3, width)
    assert len(drawn) == 4
    assert max(map(cell_len, drawn)) <= width
    assert drawn[0].startswith("2/9 done, 1 failed, 3 run" if width >= 80 else "2/9 done")
    for line in drawn[1:]:
        assert "a_" in line and "str" in line


def test_a_wide_terminal_shows_everything() -> None:
    head, first, *_ = lines(9, 3, 200)
    assert "2/9 done, 1 failed, 3 running, 4 left" in head
    assert re.search(r"about 0:00:0\d left", head)
    assert "a_scene_of_a_long_name_2 ours_in_some_variant" in first
    assert "structure 120/6000: primal 1e-03, dual 4e-02" in first


def test_a_low_terminal_is_not_overrun() -> None:
    console, output = terminal(80, height=12)
    display = half_done(60, 40, console)
    with Live(display.picture, console=console, auto_refresh=False):
        drawn = output.getvalue().splitlines()[2:]  # after the lines of the two trials that have ended
        assert len(drawn) <= 12 and drawn[-1].strip() == "..."
        display.update({})


def test_brackets_are_text_and_no_markup() -> None:
    console, output = terminal(200)
    (key, trial), *_ = trials(1).items()
    display = Display({key: trial}, console, live=False)
    display.update({key: Step("dense [red]title[/red]", "stage [/bold] of a plugin")})
    console.print(display.picture)
    assert "dense [red]title[/red]" in output.getvalue() and "stage [/bold] of a plugin" in output.getvalue()


def test_without_a_terminal_every_trial_gets_a_line() -> None:
    output = io.StringIO()
    half_done(9, 3, Console(file=output))
    assert output.getvalue().splitlines() == [
        "[1/9] a_scene_of_a_long_name_0 ours_in_some_variant: e_3d 0.0300  wrong 2/80 (2.0 s)",
        "[2/9] FAILED a_scene_of_a_long_name_1 ours_in_some_variant: it diverged (2.0 s)",
    ]


def test_trials_done_before_are_counted_and_their_failures_printed() -> None:
    output = io.StringIO()
    console = Console(file=output, width=200)
    display = Display(trials(5), console, live=False)
    display.ended("k0", BLANK, ran=False)
    display.ended("k1", replace(BLANK, status="timeout", error="took more than 1 s"), ran=False)
    console.print(display.picture)
    line, head = output.getvalue().splitlines()
    assert line == "[2/5] TIMEOUT a_scene_of_a_long_name_1 ours_in_some_variant: took more than 1 s (2.0 s)"
    assert "2/5 done, 1 failed, 0 running, 3 left" in head


def test_the_time_left_is_that_of_finished_trials_of_each_method() -> None:
    quick, slow = trials(4, "quick"), {f"s{key}": trial for key, trial in trials(3, "slow").items()}
    display = Display(quick | slow, Console(file=io.StringIO()), live=False)

    def left(*running: str) -> str:
        display.update({key: Step(key) for key in running})
        return display._time_left()

    assert left("k0", "k1") == ""  # no trial has finished
    display.ended("k0", replace(BLANK, seconds=100.0), ran=True)
    display.ended("k1", replace(BLANK, seconds=100.0), ran=True)
    assert left("k2") in ("over 0:08:20 left", "over 0:08:19 left")  # five trials, three of them of unknown length
    display.ended("sk0", replace(BLANK, seconds=1000.0), ran=False)
    assert left("k2", "sk1") in ("about 0:18:20 left", "about 0:18:19 left")  # 2 100 s and 2 1000 s, two at a time
    assert left("k2", "k3", "sk1", "sk2") in ("about 0:16:40 left", "about 0:16:39 left")  # the longest is in one piece
    for key in ("k2", "k3", "sk1", "sk2"):
        display.ended(key, replace(BLANK, seconds=None), ran=True)
    assert left() == ""


def without_codes(seen: bytes) -> str:
    """What a terminal was sent, without its control sequences."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", seen.decode(errors="replace"))


def test_a_sweep_in_a_terminal(environment: dict[str, str], tmp_path: Path) -> None:
    """One of 60 columns: the method's progress is shown while it runs, what it prints goes to its log."""
    columns = 60
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    words = ["run", "-m", *ODD, "+method.how=talk,ok", "workers=1"]
    environ = {k: v for k, v in environment.items() if k not in ("COLUMNS", "LINES")} | {"TERM": "xterm-256color"}
    command = [sys.executable, "-m", "nrsfm", *words]
    sweep = subprocess.Popen(command, env=environ, cwd=tmp_path, stdin=slave, stdout=subprocess.PIPE, stderr=slave)
    os.close(slave)
    seen = b""
    while True:
        try:
            part = os.read(master, 4096)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        seen += part
        if "gap 5e-01" in without_codes(seen):
            (tmp_path / "out/gate").touch()  # which the method waits for
    os.close(master)
    out, _ = sweep.communicate(timeout=600)
    assert sweep.returncode == 0, seen
    assert b"2 trials: 2 run." in out
    drawn = without_codes(seen)
    rows = re.split(r"[\r\n]+", drawn)
    assert max(map(cell_len, rows)) <= columns
    assert any(row.startswith("0/2 done, 1 running, 1 left") for row in rows)
    assert any("method 3/7: gap 5e-01" in row for row in rows)
    assert any(row.startswith("2/2 done, 0 running, 0 left") for row in rows)
    assert "the method speaks" not in drawn
    talked = next(t for t in tracked(tmp_path) if t.outcome.parameters["method"]["how"] == "talk")
    log = tmp_path / "out/trials" / talked.outcome.key / "log.txt"
    artifact = Tracker(talked.uri, tmp_path / "out").artifact(talked.run_id, "log.txt")
    assert artifact is not None
    for text in (log.read_text(), artifact.read_text()):
        assert "the method speaks" in text
        assert "and a library of its grumbles" in text
