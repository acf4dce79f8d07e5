"""What a sweep looks like while it runs: lines that stay in place in a terminal, a line a trial elsewhere."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from datetime import timedelta
from types import TracebackType

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from nrsfm.harness.evaluate.metrics import brief
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.text import printable
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.sweep.remaining import Remaining
from nrsfm.harness.trial.progress import Step

SECONDS = 0.5  # between two pictures


NARROW = 100  # columns, below which the bar and the time that has gone are left out


class Display:
    """Shows how far a sweep is.

    In a terminal: a line of counts and times, and below it one for each running trial. Elsewhere nothing but the line
    that every ended trial gets.

    Parameters
    ----------
    trials : mapping of str to Trial
        Those of the sweep, by key.
    console : rich.console.Console
    live : bool
        Whether lines can stay in place.
    """

    def __init__(self, trials: Mapping[str, Trial], console: Console, live: bool) -> None:
        self.live = live
        self._trials = trials
        self._console = console
        self._counts: Counter[str] = Counter()
        self._steps: dict[str, Step] = {}
        self._remaining = Remaining({key: str(trial.method["name"]) for key, trial in trials.items()})
        self._start = time.monotonic()
        self._drawn = 0.0
        self._live = Live(console=console, auto_refresh=False)

    def __enter__(self) -> Display:
        if self.live:
            self._live.start()
            self._draw()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        if self.live:
            self._steps = {}
            self._draw()
            self._live.stop()

    def ended(self, key: str, outcome: Outcome, *, ran: bool) -> None:
        """Take in a trial that ran, or was done before; say so if it ran or went wrong."""
        self._counts[outcome.status] += 1
        self._steps.pop(key, None)
        self._drawn = 0.0
        self._remaining.ended(key, outcome.seconds, time.monotonic(), ran=ran)
        if ran or outcome.status != OK:
            place = f"[{self._counts.total()}/{len(self._trials)}]"
            line = f"{place} {_words(self._trials[key].title, outcome)}"
            self._console.print(printable(line), markup=False, highlight=False, soft_wrap=not self.live)

    def running(self, steps: Mapping[str, Step]) -> None:
        """Show what is at work now."""
        now = time.monotonic()
        self._remaining.running(steps, now)
        self._steps = {key: step for key, step in steps.items() if key in self._trials}
        if self.live and now - self._drawn > SECONDS:
            self._draw()

    def _draw(self) -> None:
        self._drawn = time.monotonic()
        self._live.update(self.picture(self._drawn), refresh=True)

    def picture(self, now: float) -> RenderableType:
        """The lines as they are now; none is wider than the terminal, and all of them are within its height."""
        room = max(self._console.height - 3, 1)
        steps = list(self._steps.items())
        shown = steps if len(steps) <= room else steps[: room - 1]
        lines = [self._line(key, step, now) for key, step in shown]
        if len(shown) < len(steps):
            lines.append(_line(f"  and {len(steps) - len(shown)} more"))
        return Group(self._head(now), *lines)

    def _head(self, now: float) -> RenderableType:
        ended, total = self._counts.total(), len(self._trials)
        failed, left = ended - self._counts[OK], total - ended - len(self._steps)
        text = Text(f"{ended}/{total} done", no_wrap=True, overflow="ellipsis")
        if failed:
            text.append(f", {failed} failed", "red")
        text.append(f", {len(self._steps)} running, {max(left, 0)} left")
        rest = " "
        if ended < total and (seconds := self._remaining.seconds(now)) is not None:
            rest = f"{'about' if self._remaining.sure else 'over'} {_clock(seconds)} left"
        if self._console.width < NARROW:
            return _grid(text, Text(rest))
        bar = ProgressBar(total=max(total, 1), completed=ended, width=30)
        return _grid(text, bar, Text(_clock(now - self._start)), Text(rest))

    def _line(self, key: str, step: Step, now: float) -> RenderableType:
        title = Text(f"  {printable(step.title)}", "bold", no_wrap=True, overflow="ellipsis")
        words = Text(printable(step.words, 200), no_wrap=True, overflow="ellipsis")
        grid = Table.grid(padding=(0, 1), expand=True)
        grid.add_column(ratio=2, no_wrap=True)
        grid.add_column(ratio=3, no_wrap=True)
        grid.add_column(justify="right", no_wrap=True)
        grid.add_row(title, words, _clock(self._remaining.since(key, now)))
        return grid


def _grid(first: Text, *others: RenderableType) -> Table:
    """One line: the first part takes the room that the others leave."""
    grid = Table.grid(padding=(0, 1), expand=True)
    grid.add_column(ratio=1, no_wrap=True)
    for _ in others:
        grid.add_column(justify="right", no_wrap=True)
    grid.add_row(first, *others)
    return grid


def _line(text: str) -> Text:
    return Text(text, no_wrap=True, overflow="ellipsis")


def _clock(seconds: float) -> str:
    """``0:03:20``."""
    return str(timedelta(seconds=round(max(seconds, 0.0))))


def _words(title: str, outcome: Outcome) -> str:
    """``dance_yoga ours: e_3d 0.0318  wrong 0/116 (4.2 s)``; a failure begins with its status."""
    words = brief(outcome.metrics, outcome.n_points)
    words.append(outcome.error)
    mark = "" if outcome.status == OK else f"{outcome.status.upper()} "
    took = "" if outcome.seconds is None else f" ({outcome.seconds:.1f} s)"
    return f"{mark}{title}: {'  '.join(filter(None, words))}{took}"
