"""The verb ``ui``: open the MLflow interface on the tracker."""

from __future__ import annotations

import subprocess
import sys

from nrsfm.harness.cli.parser import Parser


def main(argv: list[str]) -> int:
    from nrsfm.harness.config.address import is_server
    from nrsfm.harness.config.settings import settings_of
    from nrsfm.harness.tracking.tracker import Tracker

    given = command_line().read(argv)
    settings = settings_of(given.overrides)
    tracker = Tracker(settings.tracking_uri, settings.output)
    if is_server(tracker.uri):
        print(tracker.uri)
        return 0
    _ = tracker.client
    command = [sys.executable, "-m", "mlflow", "ui", "--backend-store-uri", tracker.uri]
    command += ["--host", given.host, "--port", str(given.port)]
    print(f"http://{given.host}:{given.port} shows {tracker.uri}; Ctrl-C stops it", flush=True)
    return subprocess.call(command)


def command_line() -> Parser:
    parser = Parser(
        "nrsfm ui",
        "Open the MLflow interface on the store. It shows parameters, metrics and residual curves of every run.",
        """\
nrsfm ui
nrsfm ui --port 5001 output=elsewhere
nrsfm ui tracking=server tracking.uri=http://127.0.0.1:5000  # prints the server's address""",
        "Without a server it runs until Ctrl-C, for this machine alone; --host lets others in.",
    )
    parser.add_argument("--port", type=int, default=5000, help="of this machine; %(default)s by default")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on; %(default)s by default")
    parser.add_overrides()
    return parser
