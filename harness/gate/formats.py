"""Comparisons as text: for a terminal, and as Markdown, JUnit XML and JSON for a CI."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from types import MappingProxyType
from xml.etree import ElementTree

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from nrsfm.harness.gate.comparison import Comparison, Gate, Line, State
from nrsfm.harness.record.text import escape_md, one_line

STYLES = {State.PASS: "green", State.NEW: "dim", State.IMPROVED: "cyan"}  # the best first
STYLES |= dict.fromkeys((State.REGRESSED, State.MISSING, State.FAILED), "red")
HEADINGS = ("Row", "Metric", "Verdict", "Baseline", "Measured", "Allowed", "Why")


def ordered(comparison: Comparison, everything: bool = False) -> list[Line]:
    """The lines that did not pass, or all; the worst last, where a log is read first."""
    shown = [line for line in comparison.lines if everything or line.state is not State.PASS]
    return sorted(shown, key=lambda line: list(STYLES).index(line.state))


def show(comparison: Comparison, target: Console | None = None, everything: bool = False) -> None:
    """Print the lines that did not pass, or ``everything``, the worst last, and the summary.

    A terminal gets a table, anything else, such as a log, a line of plain text a metric.
    """
    target = target or Console()
    lines = ordered(comparison, everything)
    if lines and target.is_terminal:
        target.print(_table(lines))
    else:
        for line in lines:
            target.print(Text(line.text), soft_wrap=True)
    target.print(Text(comparison.summary, "bold red" if comparison.code else "bold green"), soft_wrap=True)


def _table(lines: list[Line]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for i, heading in enumerate(HEADINGS):
        table.add_column(heading, overflow="fold", justify="right" if 3 <= i < 6 else "left")
    for line in lines:
        row, metric, state, *rest = line.cells
        table.add_row(Text(row), Text(metric), Text(state, STYLES[line.state]), *map(Text, rest))
    return table


def markdown(gate: Gate) -> str:
    """The verdict, and for each comparison its summary and a table of the lines that did not pass."""
    text = f"## {'Blocked' if gate.code else 'Passed'}\n"
    for comparison in gate.comparisons:
        informs = " This does not block." * (comparison in gate.informing)
        text += f"\n**{escape_md(comparison.summary)}**{informs}\n"
        if lines := ordered(comparison):
            text += f"\n| {' | '.join(HEADINGS)} |\n{'|---' * len(HEADINGS)}|\n"
        for line in lines:
            text += "| " + " | ".join(escape_md(cell) for cell in line.cells) + " |\n"
    return text


def junit(gate: Gate) -> str:
    """A suite a comparison, a case a line; failures of a comparison that only informs count as skipped."""
    root = ElementTree.Element("testsuites", name="nrsfm compare")
    for comparison in gate.comparisons:
        informs = comparison in gate.informing
        bad = 0 if informs else len(comparison.bad)
        sizes = {"name": comparison.against, "tests": str(len(comparison.lines)), "failures": str(bad)}
        suite = ElementTree.SubElement(root, "testsuite", sizes)
        for line in comparison.lines:
            name = one_line(line.metric or "row")
            case = ElementTree.SubElement(suite, "testcase", classname=one_line(line.row), name=name)
            if line.bad or line.state is State.NEW:
                kind = "failure" if line.bad and not informs else "skipped"
                ElementTree.SubElement(case, kind, message=one_line(line.text, 500))
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def as_json(gate: Gate) -> str:
    """The exit code and every line of every comparison."""
    comparisons = [
        {
            "against": comparison.against,
            "blocks": comparison in gate.blocking,
            "code": comparison.code,
            "counts": {str(state): comparison.counts[state] for state in State},
            "lines": [asdict(line) | {"state": str(line.state), "allowed": line.allowed} for line in comparison.lines],
        }
        for comparison in gate.comparisons
    ]
    return json.dumps({"code": gate.code, "comparisons": comparisons}, indent=1, allow_nan=False) + "\n"


FORMATS: Mapping[str, Callable[[Gate], str]] = MappingProxyType({"markdown": markdown, "junit": junit, "json": as_json})
