"""Fixtures that run the command line, and a method that misbehaves, as an installed package would bring it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from nrsfm.harness.record.tracked import Tracked
from nrsfm.harness.tracking.tracker import Tracker

NAUGHTY = '''
import os, signal, time
import numpy as np
from nrsfm.methods.base import Method, Reconstruction

class Naughty(Method):
    """Does one wrong thing."""
    provides = frozenset({"labels"})
    def __init__(self, how="raise"):
        self.how = how
    def reconstruct(self, observations, n_bodies):
        tracks, progress = observations.tracks, observations.progress
        if self.how == "raise":
            raise RuntimeError("the method\\nraised <b>this</b>")
        if self.how == "login":
            raise RuntimeError("the password is " + os.environ.get("MLFLOW_TRACKING_PASSWORD", "not known here"))
        if self.how == "hang":
            time.sleep(600)
        if self.how == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.how in ("tire", "revive"):
            tries = os.path.join(os.environ["NRSFM_OUTPUT"], self.how)
            with open(tries, "a") as file:
                file.write("x")
            if self.how == "tire" or os.path.getsize(tries) < 3:
                os.kill(os.getpid(), signal.SIGKILL)
        if self.how == "segfault":
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.how == "exit":
            os._exit(3)
        if self.how == "memory":
            self.hoard = [np.zeros(2**26) for _ in range(64)]
        if self.how == "diverge":
            nowhere = np.full((len(tracks), 3, tracks.shape[2]), np.nan)
            return Reconstruction(labels=np.zeros(tracks.shape[2], int), structure=nowhere)
        if self.how == "nothing":
            return Reconstruction()
        if self.how == "talk":
            print("the method speaks")
            os.write(2, b"and a library of its grumbles")
            progress(3, 7, {"gap": 0.5})
        if self.how == "slow":
            time.sleep(1.0)
        while self.how in ("gate", "talk") and not os.path.exists(os.path.join(os.environ["NRSFM_OUTPUT"], "gate")):
            time.sleep(0.05)
        return Reconstruction(labels=np.arange(tracks.shape[2]) % n_bodies)
'''

ROOT = Path(__file__).parents[1]

Shell = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def naughty_package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for the path that holds an installed package: a module and its entry point."""
    root = tmp_path_factory.mktemp("installed")
    (root / "naughty.py").write_text(NAUGHTY)
    info = root / "naughty-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: naughty\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[nrsfm.methods]\nnaughty = naughty:Naughty\n")
    return root


@pytest.fixture
def environment(tmp_path: Path, naughty_package: Path) -> dict[str, str]:
    return {
        **os.environ,
        "NRSFM_OUTPUT": str(tmp_path / "out"),
        "NRSFM_DATA": str(tmp_path / "no-data"),
        "PYTHONPATH": os.pathsep.join([str(naughty_package), str(ROOT / "src")]),  # this checkout, installed or not
        "COLUMNS": "200",
    }


@pytest.fixture
def shell(environment: dict[str, str], tmp_path: Path) -> Shell:
    """Run the command line in a new process; extra keywords are environment variables."""

    def call(*arguments: str, timeout: float = 1200, **variables: str) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            [sys.executable, "-m", "nrsfm", *arguments],
            env=environment | variables,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
        assert "Traceback" not in done.stderr, done.stderr
        return done

    return call


@pytest.fixture
def nrsfm(
    environment: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Shell:
    """Run the command line in this process, which is quicker; otherwise as ``shell``."""
    from nrsfm.harness.cli.main import main

    monkeypatch.chdir(tmp_path)

    def call(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
        with monkeypatch.context() as patch:
            for name, value in (environment | variables).items():
                patch.setenv(name, value)
            capfd.readouterr()
            try:
                code = main(arguments)
            except SystemExit as stop:
                code = int(stop.code or 0)
            out, err = capfd.readouterr()
        return subprocess.CompletedProcess(arguments, code, out, err)

    return call


#: A scene and a method that take almost no time.
TINY = ("dataset.points=8", "dataset.frames=12", "method=edsc")
#: The same scene with the misbehaving method.
ODD = (*TINY, "~method.clusterer", "method.algorithm=naughty", "method.name=naughty")


def records(tmp_path: Path) -> dict[str, dict[str, Any]]:
    """The records in the trial folders, by key."""
    return {p.parent.name: json.loads(p.read_text()) for p in (tmp_path / "out/trials").glob("*/result.json")}


def tracked(tmp_path: Path) -> list[Tracked]:
    """The finished runs in the tracker."""
    return Tracker(f"sqlite:///{tmp_path}/out/mlflow.db", tmp_path / "out").outcomes()


def started(environment: dict[str, str], tmp_path: Path, *arguments: str) -> subprocess.Popen[str]:
    """Start the command line as a terminal does: in its own process group, which Ctrl-C reaches."""
    return subprocess.Popen(
        [sys.executable, "-m", "nrsfm", *arguments],
        env=environment,
        cwd=tmp_path,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def processes(tmp_path: Path) -> list[int]:
    """Ids of all processes whose environment names the output folder, except zombies."""
    mark, pids = f"NRSFM_OUTPUT={tmp_path}/out".encode(), []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if mark in path.read_bytes().split(b"\0") and b"Z" not in (path.parent / "stat").read_bytes().split()[2]:
                pids.append(int(path.parent.name))
        except OSError:
            continue
    return sorted(pids)


def open_gate(tmp_path: Path) -> None:
    """Let the trials of ``method.how=gate`` end, which run until this file is there."""
    (tmp_path / "out/gate").touch()


def until(condition: Callable[[], object], sweep: subprocess.Popen[str] | None = None, seconds: float = 600) -> None:
    """Wait until a condition is true; fails at once if the sweep that is to bring it about has ended."""
    end = time.monotonic() + seconds
    while not condition():
        assert sweep is None or sweep.poll() is None, f"the sweep ended before: {sweep.communicate()}"
        assert time.monotonic() < end, f"not true after {seconds:g} s"
        time.sleep(0.02)
