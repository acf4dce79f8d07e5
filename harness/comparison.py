"""What a comparison found: a line for each row and metric, its exit code, and how it is told."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum

from rich.console import Console
from rich.text import Text

from reports.text import escape_md


class State(StrEnum):
    SAME = "same"
    BETTER = "better"
    WORSE = "worse"
    MISSING = "missing"
    FAILED = "failed"
    NEW = "new"


@dataclass(frozen=True)
class Line:
    """One metric of one row.

    Parameters
    ----------
    row, metric : str
        ``n_wrong`` is in tracks, of ``n_points``; ``status`` compares how trials ended.
    state : State
    baseline, measured, slack : float or None
        Slack is how far above the baseline still counts as the same.
    n_points : int or None
    why : str
        For rows that could not be compared.
    """

    row: str
    metric: str
    state: State
    baseline: float | None = None
    measured: float | None = None
    slack: float | None = None
    n_points: int | None = None
    why: str = ""

    @property
    def bad(self) -> bool:
        return self.state in (State.WORSE, State.MISSING, State.FAILED)

    @property
    def text(self) -> str:
        """``dance_yoga ours (...): e_3d worse: 0.0318 -> 0.0402, up to 0.0334 allowed``."""
        name = {"n_wrong": "wrong tracks"}.get(self.metric, self.metric)
        said = f"{self.row}: {name} {self.state}" if self.metric else f"{self.row}: {self.state}"
        if self.baseline is not None and self.measured is not None:
            of = f" of {self.n_points}" if self.metric == "n_wrong" and self.n_points else ""
            said += f": {self.baseline:g} -> {self.measured:g}{of}"
            if self.bad and self.slack is not None:
                said += f", up to {self.baseline + self.slack:.4g} allowed"
        return f"{said}: {self.why}" if self.why else said


@dataclass(frozen=True)
class Comparison:
    """All lines, and what they amount to."""

    against: str
    lines: tuple[Line, ...]

    @property
    def counts(self) -> Counter[State]:
        return Counter(line.state for line in self.lines)

    @property
    def bad(self) -> tuple[Line, ...]:
        return tuple(line for line in self.lines if line.bad)

    @property
    def code(self) -> int:
        """0 ok, 1 worse, 2 missing or failed, which wins over worse; nothing compared counts as missing."""
        counts = self.counts
        if counts[State.MISSING] or counts[State.FAILED] or not set(counts) - {State.NEW}:
            return 2
        return 1 if counts[State.WORSE] else 0

    @property
    def summary(self) -> str:
        counts = self.counts
        said = ", ".join(f"{counts[state]} {state}" for state in State if counts[state]) or "nothing to compare"
        if self.lines and not set(counts) - {State.NEW}:
            said += "; none of it stands in the baseline"
        return f"Against {self.against}: {said}."


STYLES = {State.WORSE: "red", State.MISSING: "red", State.FAILED: "red", State.BETTER: "cyan", State.NEW: "dim"}


def show(comparison: Comparison, target: Console | None = None, everything: bool = False) -> None:
    """Print every row that is not as it was, worst first, and the summary.

    Parameters
    ----------
    comparison : Comparison
    target : rich.console.Console, optional
        Standard output by default. Plain text, one line a row whatever its width, if that is no terminal.
    everything : bool
        Print the rows that are the same, too.
    """
    target = target or Console()
    for line in _ordered(comparison, everything):
        target.print(Text(line.text, STYLES.get(line.state, "")), soft_wrap=True)
    target.print(Text(comparison.summary, "bold red" if comparison.code else "bold green"), soft_wrap=True)


def markdown(comparison: Comparison) -> str:
    """The summary and a table of the rows that are not as they were, for a CI page."""
    text = f"**{escape_md(comparison.summary)}**\n"
    if lines := _ordered(comparison, everything=False):
        text += "\n| Row | Metric | State | Baseline | Measured | Allowed | Why |\n|---|---|---|---|---|---|---|\n"
    for line in lines:
        allowed = None if line.baseline is None or line.slack is None else line.baseline + line.slack
        numbers = ("–" if value is None else f"{value:.6g}" for value in (line.baseline, line.measured, allowed))
        cells = (line.row, line.metric or "–", str(line.state), *numbers, line.why or "–")
        text += "| " + " | ".join(escape_md(cell) for cell in cells) + " |\n"
    return text


def _ordered(comparison: Comparison, everything: bool) -> list[Line]:
    order = [State.FAILED, State.MISSING, State.WORSE, State.BETTER, State.NEW, State.SAME]
    shown = [line for line in comparison.lines if everything or line.state is not State.SAME]
    return sorted(shown, key=lambda line: order.index(line.state))
