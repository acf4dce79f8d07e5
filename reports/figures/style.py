"""Colours, markers and dashes of every figure; colour-blind readers can tell the colours apart."""

from __future__ import annotations

from dataclasses import dataclass

#: Okabe and Ito's colours.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
GREY, WRONG = "#8a8f95", "#000000"


@dataclass(frozen=True)
class Look:
    """The look of a line: matplotlib's marker and dash, and plotly's names for them."""

    colour: str
    marker: str
    symbol: str
    line: str
    dash: str


_MARKERS = ("o circle", "s square", "^ triangle-up", "D diamond", "v triangle-down", "X x")
_LINES = ("- solid", "-- dash", ": dot")
_ORDER = (0, 1, 2, 4, 3, 5)  # without yellow, which is hard to see on white


def look(place: int) -> Look:
    """The look of the series at a place of a chart: no two of the first eighteen are alike."""
    marker, symbol = _MARKERS[place % len(_MARKERS)].split()
    line, dash = _LINES[(place + place // len(_MARKERS)) % len(_LINES)].split()
    return Look(COLOURS[_ORDER[place % len(_ORDER)]], marker, symbol, line, dash)
