"""Numbers and text of unknown origin for printing: on one line, in one precision, escaped for LaTeX or Markdown."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

LONGEST = 160
"""Characters of an error message that a table shows."""

DIGITS = 4
"""Decimals of an error in tables, as many as the papers print."""


def one_line(text: object, longest: int = LONGEST) -> str:
    """Text on one line, without control or invisible characters, cut to ``longest`` characters."""
    clean = "".join(c if c.isprintable() else " " for c in str(text))
    clean = " ".join(clean.split())
    return clean if len(clean) <= longest else clean[: longest - 1].rstrip() + "…"


def printable(text: object, longest: int = 2000) -> str:
    """Text for a terminal: on one line, control characters written as escapes, so that none takes effect."""
    clean = "".join(c if c.isprintable() else " " if c.isspace() else ascii(c)[1:-1] for c in str(text))
    return clean if len(clean) <= longest else clean[: longest - 1] + "…"


def did_you_mean(word: str, known: Iterable[str], group: str = "") -> str:
    """``; did you mean ours?`` where one of the known words is near, with ``group`` before it; else ""."""
    from difflib import get_close_matches

    near = get_close_matches(word, list(known), n=1)
    return f"; did you mean {group}{near[0]}?" if near else ""


def number(value: float, digits: int = DIGITS) -> str:
    """A metric with four decimals, and ``0.0`` for exactly 0, as the papers print it."""
    return "0.0" if value == 0 and digits else f"{value:.{digits}f}"


def count(value: float) -> str:
    """A count or a mean of counts: ``7`` or ``7.4``."""
    return f"{value:.1f}".removesuffix(".0")


def signed(value: float, unit: str) -> str:
    """A difference from a published number: ``+4`` (tracks), ``+0.06`` (percentage points), or ``-3.2 %`` of it."""
    if unit == "percentage points":
        text = f"{value:+.2f}"
    else:
        text = f"{value:+.1f}".removesuffix(".0") if unit == "tracks" else f"{100 * value:+.1f} %"
    return text if text.strip("+-0. %") else text[1:]


class Safe(str):
    """Text that is already LaTeX or Markdown, which :func:`escape_tex` and :func:`escape_md` leave alone."""

    __slots__ = ()


_COMMANDS = {"\\": "textbackslash", "^": "textasciicircum", "~": "textasciitilde", "<": "textless", ">": "textgreater"}
_COMMANDS |= {"|": "textbar", "…": "ldots"}
_MATHS = {"±": r"\pm", "−": "-", "·": r"\cdot", "×": r"\times"}
_TEX = {c: f"\\{c}" for c in "{}$&#%_"} | {c: f"{{{c}}}" for c in "*[]"}
_TEX |= {c: rf"\{name}{{}}" for c, name in _COMMANDS.items()} | {c: f"${maths}$" for c, maths in _MATHS.items()}


def escape_tex(value: object) -> str:
    """LaTeX that prints the text; ASCII only, so that every engine reads it."""
    return value if isinstance(value, Safe) else "".join(_tex(c) for c in _on_one_line(value))


def _tex(c: str) -> str:
    if c in _TEX:
        return _TEX[c]
    if c.isascii():
        return c
    plain = unicodedata.normalize("NFKD", c).encode("ascii", "ignore").decode()
    return "".join(_TEX.get(p, p) for p in plain) or f"{{[}}U+{ord(c):04X}{{]}}"


_MARKDOWN = re.compile(r"([\\|`*\[\]~#$])|((?<!\w)_|_(?!\w))")


def escape_md(value: object) -> str:
    """Markdown that prints the text, also inside a table cell."""
    if isinstance(value, Safe):
        return value
    text = _on_one_line(value).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return _MARKDOWN.sub(lambda m: "\\" + m.group(0), text)


def _on_one_line(value: object) -> str:
    """Text on one line, uncut (templates pass long notes), with the spaces at its ends."""
    return re.sub(" +", " ", "".join(c if c.isprintable() else " " for c in str(value)))
