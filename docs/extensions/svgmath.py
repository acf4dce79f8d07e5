"""Draw equations as SVG while the site is built, so that pages need no script, font or network."""

from __future__ import annotations

import html
import re
from typing import Any

import ziamath
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging

SIZE = {"inline": 16.5, "display": 18.0}
BOLD_ONE = (r"\mathbf{1}", "\U0001d7cf")  # bold digits are letters of their own in the font
APART = (re.compile(r"(?<=[\w)}])\s*\\operatorname"), r"\\,\\operatorname")  # U diag(s), not Udiag(s)

logger = logging.getLogger(__name__)
ziamath.config.math.color = "currentColor"
ziamath.config.svg2 = False  # no identifiers, which would clash within a page


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_html_math_renderer("svg", (_inline, None), (_display, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


def drawn(latex: str, kind: str, node: nodes.Element) -> str:
    """An equation as SVG on the text's baseline, with its LaTeX source as the label for screen readers."""
    try:
        spaced = APART[0].sub(APART[1], latex.replace(*BOLD_ONE))
        equation = ziamath.Latex(spaced, size=SIZE[kind], inline=kind == "inline")
        svg = str(equation.svg())
        if unknown := re.search(r"<m[ino]>(\\\w+)", equation.mathmlstr()):
            raise ValueError(f"{unknown[1]} is an unknown command")
    except Exception as error:
        logger.warning("cannot draw the equation %s: %s", latex, error, location=node)
        return f"<code>{html.escape(latex)}</code>"
    box = re.search(r'viewBox="\S+ (\S+) \S+ (\S+)"', svg)
    assert box is not None, "ziamath draws with a viewBox"
    top, height = float(box[1]), float(box[2])
    spoken, place = html.escape(" ".join(latex.split())), f"vertical-align:{-top - height:.2f}px"
    return svg.replace("<svg ", f'<svg role="img" aria-label="{spoken}" style="{place}" ', 1)


def _inline(self: Any, node: nodes.Element) -> None:
    self.body.append(f'<span class="math">{drawn(node.astext(), "inline", node)}</span>')
    raise nodes.SkipNode


def _display(self: Any, node: nodes.Element) -> None:
    self.body.append(f'<div class="math">{drawn(node.astext(), "display", node)}</div>')
    raise nodes.SkipNode
