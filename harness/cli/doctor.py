"""The verb ``doctor``: check this installation, and say how to mend what does not work."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict

from nrsfm.harness.cli.parser import Parser
from nrsfm.harness.doctor.requirements import NOTE, OK, PROBLEM, Finding, extras, plural, versions

COLOURS = {OK: 32, NOTE: 33, PROBLEM: 31}  # of a terminal


def main(argv: Sequence[str]) -> int:
    """Print the findings; exit code 0 when nrsfm can be used, 2 when something stands in the way.

    Raises
    ------
    UsageError
        If the overrides cannot be used.
    """
    begun = time.monotonic()
    options = command_line().read(argv)
    done = []
    for finding in findings(options.overrides):
        done.append(finding)
        if not options.json:
            print(_line(finding), flush=True)
    states = [finding.state for finding in done]
    if options.json:
        data = {"usable": PROBLEM not in states, "findings": [asdict(finding) for finding in done]}
        print(json.dumps(data, indent=1, ensure_ascii=False))
    else:
        counts = [f"{n} {plural(state, n)}" for state in (PROBLEM, NOTE) if (n := states.count(state))]
        verdict = "something stands in the way" if PROBLEM in states else "nrsfm can be used"
        print(f"{', '.join([verdict, *counts])}; {time.monotonic() - begun:.1f} s")
    return 2 if PROBLEM in states else 0


def findings(overrides: Sequence[str]) -> Iterator[Finding]:
    """Run the checks one after the other; raises UsageError on overrides that cannot be used."""
    try:
        from nrsfm.harness.trial.isolation import start_server

        start_server()  # its libraries load while those of this process do
        from nrsfm.harness.config.settings import settings_of
        from nrsfm.harness.doctor.checks import CHECKS
    except ImportError as error:
        yield from (*versions(), *extras())
        remedy = "install again, into an environment of its own"
        yield Finding("libraries", PROBLEM, f"cannot be loaded: {' '.join(str(error).split())}", remedy)
        return
    settings = settings_of(overrides)
    yield from (*versions(), *extras())
    for check in CHECKS:
        yield from check(settings)


def _line(finding: Finding) -> str:
    colour = COLOURS[finding.state] if sys.stdout.isatty() and not os.environ.get("NO_COLOR") else None
    state = f"{finding.state:8}" if colour is None else f"\x1b[{colour}m{finding.state:8}\x1b[0m"
    return f"{state}{finding.topic:11}{finding.text}" + (f"; {finding.remedy}" if finding.remedy else "")


def command_line() -> Parser:
    parser = Parser(
        "nrsfm doctor",
        "Check this installation and print what works and what does not, each problem with its remedy.",
        """\
nrsfm doctor
nrsfm doctor workers=8 threads=2  # would a run with these fit this machine?
nrsfm doctor tracking=server tracking.uri=http://127.0.0.1:5000  # does the server answer?
nrsfm doctor --json > doctor.json  # for a bug report; contains no passwords""",
        "exit codes: 0 usable, 2 a problem stands in the way, 3 usage",
    )
    parser.add_overrides()
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    return parser
