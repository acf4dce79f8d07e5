"""A tracking server in place of the store's file: the report needs nothing else."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.harness.conftest import Shell


@pytest.fixture
def server(tmp_path: Path) -> Iterator[str]:
    """The address of an MLflow server on this machine, with its own store and artifacts."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    place = ["--backend-store-uri", f"sqlite:///{tmp_path}/server.db", "--artifacts-destination", f"{tmp_path}/kept"]
    command = [sys.executable, "-m", "mlflow", "server", *place, "--host", "127.0.0.1", "--port", str(port)]
    process = subprocess.Popen(
        [*command, "--workers", "1"],
        env=os.environ | {"MLFLOW_DISABLE_TELEMETRY": "true"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    address = f"http://127.0.0.1:{port}"
    try:
        for _ in range(480):
            try:
                with urllib.request.urlopen(f"{address}/health", timeout=2):
                    break
            except OSError:
                time.sleep(0.25)
        yield address
    finally:
        process.terminate()
        process.wait(30)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_report_is_rebuilt_from_a_server_alone(shell: Shell, server: str, tmp_path: Path) -> None:
    words = ("tracking=server", f"tracking.uri={server}", "dataset.points=8", "dataset.frames=12", "noise.level=0")
    methods = "method=edsc,bmm_ssc3d"
    assert shell("run", "+experiment=quick", *words, methods).returncode == 0
    elsewhere = {"HARNESS_OUTPUT": str(tmp_path / "elsewhere")}  # no trial folder here
    reports = []
    for variables in ({}, elsewhere):
        done = shell("report", "quick", *words, methods, "--quiet", **variables)
        assert done.returncode == 0, done.stderr
        folder = Path(variables.get("HARNESS_OUTPUT", tmp_path / "out")) / "report"
        reports.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert reports[0] == reports[1]
    page = reports[1]["index.html"].decode()
    assert re.search(rf'"link":"{re.escape(server)}/#/', page)
    assert '"view":' in page  # the arrays came from the server's artifacts
