"""What a sweep looks like while it runs, in terminals of any size and where there is none."""

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
import time
from dataclasses import replace
from pathlib import Path

import pytest
from rich.cells import cell_len
from rich.console import Console

from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.sweep.display import Display
from nrsfm.harness.tracking.tracker import Tracker
from nrsfm.harness.trial.progress import Step
from tests.shell import ODD, tracked

BLANK = Outcome("", "", "ok", "d", "ours", "known", "", "", 0.0, 0, seconds=2.0)


def trials(n: int) -> dict[str, Trial]:
    kinds = ("a_scene_of_a_long_name", "ours_in_some_variant")
    return {
        f"k{i}": Trial({"name": f"{kinds[0]}_{i}"}, {"name": kinds[1]}, {"source": "known"}, {"level": 0, "repeat": 0})
        for i in range(n)
    }


def lines(display: Display, width: int, height: int = 24) -> list[str]:
    """The picture as a terminal of that size gets it."""
    display._console = Console(file=io.StringIO(), force_terminal=True, width=width, height=height, color_system=None)
    display._console.print(display.picture(time.monotonic()))
    return display._console.file.getvalue().splitlines()


def started(n: int, running: int) -> Display:
    """A sweep of which two trials ended and some are at work."""
    asked = trials(n)
    display = Display(asked, Console(file=io.StringIO()), live=False)
    display.ended("k0", replace(BLANK, metrics={"e_3d": 0.03, "n_wrong": 2.0}, n_points=80), ran=True)
    display.ended("k1", replace(BLANK, status="failed", error="it diverged"), ran=True)
    step = Step("", "structure", 120, 6000, {"primal": 1e-3, "dual": 4e-2})
    display.running({f"k{i}": replace(step, title=asked[f"k{i}"].title) for i in range(2, 2 + running)})
    return display


@pytest.mark.parametrize("width", [30, 60, 80, 100, 200])
def test_no_line_is_wider_than_the_terminal(width: int) -> None:
    found = lines(started(9, 3), width)
    assert len(found) == 4
    assert max(map(cell_len, found)) <= width
    assert found[0].startswith("2/9 done, 1 failed, 3 run" if width >= 60 else "2/9 done")
    for line in found[1:]:
        assert "a_" in line and "str" in line


def test_a_wide_terminal_has_it_all() -> None:
    head, first, *_ = lines(started(9, 3), 200)
    assert "2/9 done, 1 failed, 3 running, 4 left" in head
    assert re.search(r"about \d+.* left", head)
    assert "a_scene_of_a_long_name_2 ours_in_some_variant" in first
    assert "structure 120/6000: primal 1e-03, dual 4e-02" in first


def test_a_low_terminal_is_not_overrun() -> None:
    found = lines(started(60, 40), 80, height=12)
    assert len(found) <= 12
    assert found[-1].strip() == "and 32 more"


def test_without_a_terminal_every_trial_gets_a_line() -> None:
    display = started(9, 3)
    assert display._console.file.getvalue().splitlines() == [
        "[1/9] a_scene_of_a_long_name_0 ours_in_some_variant: e_3d 0.0300  wrong 2/80 (2.0 s)",
        "[2/9] FAILED a_scene_of_a_long_name_1 ours_in_some_variant: it diverged (2.0 s)",
    ]


def test_what_was_done_before_is_counted_and_its_failures_are_told() -> None:
    display = Display(trials(5), Console(file=io.StringIO()), live=False)
    display.ended("k0", BLANK, ran=False)
    display.ended("k1", replace(BLANK, status="timeout", error="took more than 1 s"), ran=False)
    (told,) = display._console.file.getvalue().splitlines()
    assert told == "[2/5] TIMEOUT a_scene_of_a_long_name_1 ours_in_some_variant: took more than 1 s (2.0 s)"
    assert "2/5 done, 1 failed, 0 running, 3 left" in lines(display, 200)[0]


def test_a_sweep_in_a_terminal(environment: dict[str, str], tmp_path: Path) -> None:
    """A real one of 60 columns: what the method reports is seen while it runs, what it prints goes to its log."""
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
    os.close(master)
    out, _ = sweep.communicate(timeout=60)
    assert sweep.returncode == 0, seen
    assert b"2 trials: 2 run." in out
    drawn = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", seen.decode())
    rows = re.split(r"[\r\n]+", drawn)
    assert max(map(cell_len, rows)) <= columns
    assert any(row.startswith("0/2 done, 1 running, 1 left") for row in rows)
    assert any("method 3/7: gap 5e-01" in row for row in rows)
    assert any(row.startswith("2/2 done, 0 running, 0 left") for row in rows)
    assert "the method speaks" not in drawn
    talked = next(t for t in tracked(tmp_path) if t.outcome.parameters["method"]["how"] == "talk")
    log = tmp_path / "out/trials" / talked.outcome.key / "log.txt"
    assert Tracker(talked.uri, tmp_path / "out").fetch(talked.run_id, "log.txt", tmp_path / "fetched")
    for text in (log.read_text(), (tmp_path / "fetched/log.txt").read_text()):
        assert "the method speaks" in text
        assert "and a library of its grumbles" in text
