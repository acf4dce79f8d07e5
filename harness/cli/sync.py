"""The verb ``sync``: write every trial record into the tracker."""

from __future__ import annotations

import sys

from nrsfm.harness.cli.parser import Parser


def main(argv: list[str]) -> int:
    """Write the records; exit code 2 when some could not be written."""
    from nrsfm.harness.config.settings import settings_of
    from nrsfm.harness.record.text import printable
    from nrsfm.harness.tracking.tracker import Tracker

    settings = settings_of(command_line().read(argv).overrides)
    tracker = Tracker(settings.tracking_uri, settings.output)
    written, trouble = tracker.sync(settings.trials)
    print(f"{written} run{'' if written == 1 else 's'} written to {tracker.uri}")
    for line in trouble:
        print(f"nrsfm sync: {printable(line)}", file=sys.stderr)
    return 2 if trouble else 0


def command_line() -> Parser:
    parser = Parser(
        "nrsfm sync",
        "Write every trial record into the tracker: after it was out of reach or lost, or into another tracker.",
        """\
nrsfm sync
nrsfm sync output=elsewhere  # the trials of another folder, into its own store
nrsfm sync tracking=server tracking.uri=http://127.0.0.1:5000  # into an MLflow server""",
        "The records in outputs/trials are the truth. The tracker can be rebuilt from them at any time.",
    )
    parser.add_overrides()
    return parser
