"""The verb ``ui``: open the MLflow interface on the tracker."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress

from nrsfm.harness.cli.parser import Parser

PATIENCE = 5.0  # seconds in which the interface must end


def main(argv: list[str]) -> int:
    """Start the interface, or print the address of the server; returns the exit code of MLflow."""
    from nrsfm.harness.config.address import is_server
    from nrsfm.harness.config.settings import settings_of
    from nrsfm.harness.tracking.tracker import Tracker

    options = command_line().read(argv)
    settings = settings_of(options.overrides)
    tracker = Tracker(settings.tracking_uri, settings.output)
    if is_server(tracker.uri):
        print(tracker.uri)
        return 0
    # MLflow's first page is that of its other half, which is for language models
    place = f"http://{options.host}:{options.port}/#/experiments/{tracker.experiment}?workflowType=machine_learning"
    command = [sys.executable, "-m", "mlflow", "server", *tracker.served, "--workers", "1"]
    command += ["--host", options.host, "--port", str(options.port)]
    print(f"{place} shows {tracker.uri}; Ctrl-C stops it", flush=True)
    return _until_stopped(command)


def _until_stopped(command: list[str]) -> int:
    """Run a command with all that it starts, until it ends or this process is told to end; returns its exit code.

    The signal is noted alone: raised amid the start, an exception would leave behind what was started.
    """
    from nrsfm.harness.trial.signals import on_signals

    told = threading.Event()
    with on_signals(signal.SIGINT, signal.SIGTERM, signal.SIGHUP, do=lambda *_: told.set()):
        child = subprocess.Popen(command, start_new_session=True)
        while child.poll() is None and not told.wait(0.2):
            pass
        for number in (signal.SIGTERM, signal.SIGKILL):
            with suppress(ProcessLookupError, subprocess.TimeoutExpired):
                os.killpg(child.pid, number)
                child.wait(PATIENCE)
    if told.is_set():
        raise KeyboardInterrupt
    return child.wait()


def command_line() -> Parser:
    parser = Parser(
        "nrsfm ui",
        "Open the MLflow interface on the store. It shows parameters, metrics and residual curves of every run.",
        """\
nrsfm ui
nrsfm ui --port 5001 output=elsewhere
nrsfm ui tracking=server tracking.uri=http://127.0.0.1:5000  # prints the server's address""",
        "Without a server it runs until Ctrl-C. Only this machine can open it; --host opens it to others.",
    )
    parser.add_argument("--port", type=int, default=5000, help="port of this machine; %(default)s by default")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on; %(default)s by default")
    parser.add_overrides()
    return parser
