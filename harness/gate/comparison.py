"""What a comparison found: a line for each row and metric, its exit code, and how a terminal tells it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text


class State(StrEnum):
    """Verdict on one cell: passed within its tolerance, improved or regressed beyond it, or not compared."""

    PASS = "pass"
    IMPROVED = "improved"
    REGRESSED = "regressed"
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
        return self.state in (State.REGRESSED, State.MISSING, State.FAILED)

    @property
    def allowed(self) -> float | None:
        """The largest value that passes."""
        return None if self.baseline is None or self.slack is None else self.baseline + self.slack

    @property
    def cells(self) -> tuple[str, ...]:
        """Row, metric, verdict, baseline, measured, allowed and why, a dash for what there is not."""
        numbers = ("–" if value is None else f"{value:.6g}" for value in (self.baseline, self.measured, self.allowed))
        return (self.row, self.metric or "–", str(self.state), *numbers, self.why or "–")

    @property
    def text(self) -> str:
        """``dance_yoga ours (...): e_3d regressed: 0.0318 -> 0.0402, up to 0.0334 allowed``."""
        name = {"n_wrong": "wrong tracks"}.get(self.metric, self.metric)
        said = f"{self.row}: {name} {self.state}" if self.metric else f"{self.row}: {self.state}"
        if self.baseline is not None and self.measured is not None:
            of = f" of {self.n_points}" if self.metric == "n_wrong" and self.n_points else ""
            said += f": {self.baseline:g} -> {self.measured:g}{of}"
            if self.bad and self.allowed is not None:
                said += f", up to {self.allowed:.4g} allowed"
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
        return 1 if counts[State.REGRESSED] else 0

    @property
    def summary(self) -> str:
        counts = self.counts
        said = ", ".join(f"{counts[state]} {state}" for state in State if counts[state]) or "nothing to compare"
        if self.lines and not set(counts) - {State.NEW}:
            said += "; none of it stands in the baseline"
        return f"Against {self.against}: {said}."


STYLES = {
    State.PASS: "green",
    State.REGRESSED: "red",
    State.MISSING: "red",
    State.FAILED: "red",
    State.IMPROVED: "cyan",
    State.NEW: "dim",
}


ORDER = (State.PASS, State.NEW, State.IMPROVED, State.REGRESSED, State.MISSING, State.FAILED)


def ordered(comparison: Comparison, everything: bool = False) -> list[Line]:
    """The lines that did not simply pass, or all; the worst last, where a log is read first."""
    shown = [line for line in comparison.lines if everything or line.state is not State.PASS]
    return sorted(shown, key=lambda line: ORDER.index(line.state))


def show(comparison: Comparison, target: Console | None = None, everything: bool = False) -> None:
    """Print what did not simply pass, worst last, and the summary.

    Parameters
    ----------
    comparison : Comparison
    target : rich.console.Console, optional
        Standard output by default. A table in a terminal; else plain text, one line a cell whatever its width.
    everything : bool
        Print the cells that pass, too.
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
    for heading in ("Row", "Metric", "Verdict", "Baseline", "Measured", "Allowed", "Why"):
        numbers = heading in ("Baseline", "Measured", "Allowed")
        table.add_column(heading, overflow="fold", justify="right" if numbers else "left")
    for line in lines:
        row, metric, state, *rest = line.cells
        table.add_row(Text(row), Text(metric), Text(state, STYLES[line.state]), *map(Text, rest))
    return table
