"""The verb ``doctor``: what of this installation works, and the remedy for what does not."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator, Sequence

from nrsfm.harness.cli.parser import Parser
from nrsfm.harness.doctor.requirements import NOTE, OK, PROBLEM, Finding, extras, plural, versions
from nrsfm.harness.trial.isolation import start_server

COLOURS = {OK: 32, NOTE: 33, PROBLEM: 31}  # of a terminal


def main(argv: Sequence[str]) -> int:
    """Print the findings; exit code 0 when the harness can be used, 2 when something stands in the way.

    Raises
    ------
    UsageError
        If the overrides cannot be used.
    """
    begun = time.monotonic()
    given = command_line().read(argv)
    start_server()  # it loads its libraries while this process does
    found = []
    for finding in findings(given.overrides):
        found.append(finding)
        if not given.json:
            print(_line(finding), flush=True)
    states = [finding.state for finding in found]
    if given.json:
        data = {"usable": PROBLEM not in states, "findings": [finding.__dict__ for finding in found]}
        print(json.dumps(data, indent=1, ensure_ascii=False))
    else:
        counts = [f"{n} {plural(state, n)}" for state in (PROBLEM, NOTE) if (n := states.count(state))]
        verdict = "something stands in the way" if PROBLEM in states else "the harness can be used"
        print(f"{', '.join([verdict, *counts])}; {time.monotonic() - begun:.1f} s")
    return 2 if PROBLEM in states else 0


def findings(overrides: Sequence[str]) -> Iterator[Finding]:
    """What is found, one after the other; raises UsageError on overrides that cannot be used."""
    try:
        from nrsfm.harness.config.compose import compose_config
        from nrsfm.harness.config.settings import read
        from nrsfm.harness.doctor.checks import CHECKS
    except ImportError as error:  # then what is missing stands in the first lines
        yield from (*versions(), *extras())
        remedy = "install again, into an environment of its own"
        yield Finding("libraries", PROBLEM, f"cannot be loaded: {' '.join(str(error).split())}", remedy)
        return
    settings = read(compose_config(overrides))[1]
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
        "Say what of this installation works and what does not, each problem with its remedy.",
        """\
nrsfm doctor
nrsfm doctor workers=8 threads=2  # would a run with these fit this machine?
nrsfm doctor tracking=server tracking.uri=http://127.0.0.1:5000  # does the server answer?
nrsfm doctor --json > doctor.json  # to send along; holds no passwords""",
        "exit codes: 0 usable, 2 a problem stands in the way, 3 usage",
    )
    parser.add_overrides()
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    return parser
