"""Formulas of docstrings are plain text: |E|_1, X', C* and indented lines are not read as markup."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

KEPT = re.compile(r"(``.+?``|:[a-z:]+:`[^`]+`)")  # code and references
SECTION = re.compile(r"^-{3,}$")


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("autodoc-process-docstring", _process, priority=400)  # before napoleon
    return {"version": "1", "parallel_read_safe": True}


def _process(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    lines[:] = plain(lines)
    if what in ("data", "attribute"):
        lines.insert(0, "")  # else the text before a colon is taken for a type


def plain(lines: list[str]) -> list[str]:
    """Escape a docstring's markup except code and references, and make its indented formulas literal blocks."""
    made: list[str] = []
    section = False  # a numpy section indents its descriptions
    literal = False
    for number, line in enumerate(lines):
        if number + 1 < len(lines) and SECTION.match(lines[number + 1]):
            section = True
        indented = line.startswith("    ") and not section
        if indented and not literal and (not made or not made[-1].strip()):
            if not (made and made[-1] == "" and len(made) > 1 and made[-2].endswith("::")):
                made += ["::", ""]
            literal = True
        elif line.strip() and not line.startswith(" "):
            literal = False
        made.append(line if literal or SECTION.match(line) else _escaped(line))
    return made


def _escaped(line: str) -> str:
    parts = KEPT.split(line)
    parts[::2] = [re.sub(r"([\\*|`])", r"\\\1", part) for part in parts[::2]]
    parts[::2] = [re.sub(r"(?<=\w)_(?=\W|$)", r"\\_", part) for part in parts[::2]]
    return "".join(parts)
