"""Comparisons as a CI reads them: Markdown for its summary, JUnit XML for its test report, JSON for anything else."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from xml.etree import ElementTree

from nrsfm.harness.gate.comparison import Comparison, State, ordered
from nrsfm.harness.record.text import escape_md, one_line


@dataclass(frozen=True)
class Gate:
    """Comparisons that block, and others that only inform.

    Parameters
    ----------
    blocking, informing : tuple of Comparison
    """

    blocking: tuple[Comparison, ...]
    informing: tuple[Comparison, ...] = ()

    @property
    def code(self) -> int:
        """The largest of the blocking comparisons' exit codes."""
        return max((comparison.code for comparison in self.blocking), default=0)


def markdown(gate: Gate) -> str:
    """The verdict, then for each comparison its summary and a table of what did not simply pass."""
    text = f"## {'Blocked' if gate.code else 'Passed'}\n"
    for comparison in (*gate.informing, *gate.blocking):
        informs = " This informs and blocks nothing." * (comparison in gate.informing)
        text += f"\n**{escape_md(comparison.summary)}**{informs}\n"
        if lines := ordered(comparison):
            text += (
                "\n| Row | Metric | Verdict | Baseline | Measured | Allowed | Why |\n|---|---|---|---|---|---|---|\n"
            )
        for line in lines:
            text += "| " + " | ".join(escape_md(cell) for cell in line.cells) + " |\n"
    return text


def junit(gate: Gate) -> str:
    """A suite for each comparison, a case for each cell; what only informs is skipped, not failed."""
    root = ElementTree.Element("testsuites", name="nrsfm compare")
    for comparison in (*gate.informing, *gate.blocking):
        informs = comparison in gate.informing
        bad = 0 if informs else len(comparison.bad)
        suite = ElementTree.SubElement(
            root, "testsuite", name=comparison.against, tests=str(len(comparison.lines)), failures=str(bad)
        )
        for line in comparison.lines:
            name = one_line(line.metric or "row")
            case = ElementTree.SubElement(suite, "testcase", classname=one_line(line.row), name=name)
            if line.bad or line.state is State.NEW:
                kind = "failure" if line.bad and not informs else "skipped"
                ElementTree.SubElement(case, kind, message=one_line(line.text, 500))
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def as_json(gate: Gate) -> str:
    """Everything: exit code, and every line of every comparison."""
    comparisons = [
        {
            "against": comparison.against,
            "blocks": comparison in gate.blocking,
            "code": comparison.code,
            "counts": {str(state): comparison.counts[state] for state in State},
            "lines": [asdict(line) | {"state": str(line.state), "allowed": line.allowed} for line in comparison.lines],
        }
        for comparison in (*gate.informing, *gate.blocking)
    ]
    return json.dumps({"code": gate.code, "comparisons": comparisons}, indent=1, allow_nan=False) + "\n"


FORMATS: Mapping[str, Callable[[Gate], str]] = MappingProxyType({"markdown": markdown, "junit": junit, "json": as_json})
