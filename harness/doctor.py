"""The verb ``doctor``: what of this installation works, and the remedy for what does not."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator, Sequence

from harness import parsers
from harness.isolation import start_server
from harness.requirements import NOTE, OK, PROBLEM, Finding, extras, plural, versions

COLOURS = {OK: 32, NOTE: 33, PROBLEM: 31}  # of a terminal


def main(argv: Sequence[str]) -> int:
    """Print the findings; exit code 0 when the harness can be used, 2 when something stands in the way.

    Raises
    ------
    UsageError
        If the overrides cannot be used.
    """
    begun = time.monotonic()
    given = parsers.doctor().read(argv)
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
        from harness.checks import CHECKS
        from harness.configurations import compose_config
        from harness.experiments import read
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
