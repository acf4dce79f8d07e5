"""The verb ``ui``: open the MLflow interface on the tracker."""

from __future__ import annotations

import subprocess
import sys

from nrsfm.harness.cli.parser import Parser


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
    _ = tracker.client  # creates a store that is missing
    command = [sys.executable, "-m", "mlflow", "ui", "--backend-store-uri", tracker.uri]
    command += ["--host", options.host, "--port", str(options.port)]
    print(f"http://{options.host}:{options.port} shows {tracker.uri}; Ctrl-C stops it", flush=True)
    return subprocess.call(command)


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
