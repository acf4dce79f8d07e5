"""CPU seconds of whole commands, those of all their processes, beside a bare import of numpy and Hydra.

    pytest tests/benchmarks/test_latency.py --override-ini addopts= --no-header -q

prints the table. Figures are of one machine under its load; the ratios hold on others.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from rich.table import Table

from tests.benchmarks.shown import show
from tests.shell import ROOT, TINY

ROUNDS = 3
NRSFM = ("-m", "nrsfm")
#: What is done, and its command; the last ones answer from a sweep that has run.
COMMANDS: Mapping[str, Sequence[str]] = {
    "numpy and Hydra imported": ("-c", "import numpy, hydra"),
    "an unknown verb": (*NRSFM, "ron"),
    "an unknown method": (*NRSFM, "run", "method=edcs"),
    "a missing file": (*NRSFM, "solve", "none.npz", "--bodies", "2"),
    "an unknown key": (*NRSFM, "run", "noise.levl=1"),
    "completion of method=": (*NRSFM, "run"),
    "a tiny trial": (*NRSFM, "run", *TINY, "rerun=all"),
    "104 trials planned": (*NRSFM, "plan", "experiment=tables"),
    "their sweep again": (*NRSFM, "run", "experiment=tables"),
    "a report of 10 trials": (*NRSFM, "report", "quick", "--quiet"),
    "10 trials compared": (*NRSFM, "compare"),
    "doctor": (*NRSFM, "doctor"),
}

#: Runs a command and prints the CPU seconds of all processes that come from it, orphans as well (Linux).
MEASURE = """
import ctypes, os, resource, subprocess, sys
ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER: orphans are waited for here
subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
try:
    while True:
        os.wait()
except ChildProcessError:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(used.ru_utime + used.ru_stime)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="adds up processes as Linux does")
def test_cpu_seconds_of_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    variables = {
        **os.environ,
        "NRSFM_OUTPUT": str(tmp_path / "out"),
        "NRSFM_DATA": str(tmp_path / "no-data"),  # so that the sweep of 104 is short: its trials have no data
        "PYTHONPATH": str(ROOT / "src"),
        "COMP_LINE": "nrsfm run method=",
        "COMP_POINT": "17",
        "_ARGCOMPLETE_STDOUT_FILENAME": os.devnull,
    }

    def seconds(name: str, command: Sequence[str]) -> float:
        extra = {"_ARGCOMPLETE": "1"} if name.startswith("completion") else {}
        words = [sys.executable, "-c", MEASURE, sys.executable, *command]
        done = subprocess.run(words, env=variables | extra, cwd=tmp_path, capture_output=True, text=True, check=True)
        return float(done.stdout)

    for experiment in ("tables", "quick"):
        seconds("", (*NRSFM, "run", f"experiment={experiment}"))
    cost = {name: min(seconds(name, command) for _ in range(ROUNDS)) for name, command in COMMANDS.items()}
    bare = next(iter(cost.values()))
    table = Table("what", "CPU s", "ratio", title="CPU seconds of commands, all processes")
    for name, value in cost.items():
        table.add_row(name, f"{value:.2f}", f"{value / bare:.1f}")
    show(capsys, table, f"least of {ROUNDS}")
    assert all(value > 0 for value in cost.values())
