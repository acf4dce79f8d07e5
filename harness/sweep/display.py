"""The progress display of a sweep: live lines in a terminal, one line for each finished trial elsewhere."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from datetime import timedelta
from statistics import fmean
from types import TracebackType

from rich.console import Console, Group
from rich.live import Live
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Column

from nrsfm.harness.evaluate.metrics import brief
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.text import printable
from nrsfm.harness.record.trial import Trial, titles
from nrsfm.harness.trial.progress import Step

SECONDS = 0.5  # between two refreshes
NARROW = 100  # columns, below which the bar and the elapsed time of the sweep are left out


class Display:
    """Shows how far a sweep is.

    In a terminal there is a line with counts and times, and below it a line for each running trial, as many as the
    terminal has room for. Elsewhere only the line for each finished trial is printed. ``live`` says whether the
    console is a terminal, whose lines can be redrawn.
    """

    def __init__(self, trials: Mapping[str, Trial], console: Console, live: bool) -> None:
        self.live = live
        self._titles = dict(zip(trials, titles(list(trials.values())), strict=True))
        self._console = console
        self._counts: Counter[str] = Counter()
        self._left = {key: str(trial.method["name"]) for key, trial in trials.items()}  # methods of unfinished trials
        self._took: dict[str, list[float]] = {}  # seconds of finished trials, by method
        self._running: dict[str, TaskID] = {}
        columns = [_text("  [bold]{task.description}", ratio=2), _text("{task.fields[step]}", ratio=3)]
        self._steps = Progress(*columns, TimeElapsedColumn(), console=console, expand=True)
        wide: list[ProgressColumn] = [BarColumn(30), TimeElapsedColumn()] if console.width >= NARROW else []
        last = TextColumn("{task.fields[left]}", table_column=Column(justify="right", no_wrap=True))
        self._head = Progress(_text("{task.description}", ratio=1), *wide, last, console=console, expand=True)
        self._total = self._head.add_task("", total=max(len(trials), 1), left="")
        self.picture = Group(self._head, self._steps)
        self._live = Live(self.picture, console=console, auto_refresh=False)
        self._drawn = 0.0
        self._write_head()

    def __enter__(self) -> Display:
        if self.live:
            self._live.start(refresh=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        if self.live:
            self.update({})
            self._live.refresh()
            self._live.stop()

    def ended(self, key: str, outcome: Outcome, *, ran: bool) -> None:
        """Count a finished trial, and print its line if it ran now, failed, or is the only one."""
        self._counts[outcome.status] += 1
        method = self._left.pop(key)
        if outcome.seconds is not None:
            self._took.setdefault(method, []).append(outcome.seconds)
        if key in self._running:
            self._steps.remove_task(self._running.pop(key))
        self._drawn = 0.0
        self._write_head()
        if ran or outcome.status != OK or len(self._titles) == 1:
            place = f"[{self._counts.total()}/{len(self._titles)}]"
            line = f"{place} {_words(self._titles[key], outcome)}"
            self._console.print(printable(line), markup=False, highlight=False, soft_wrap=not self.live)

    def update(self, steps: Mapping[str, Step]) -> None:
        """Show these trials, by key, as running."""
        for key in self._running.keys() - steps.keys():
            self._steps.remove_task(self._running.pop(key))
        for key, step in steps.items():
            if key not in self._left:
                continue
            if key not in self._running:
                self._running[key] = self._steps.add_task(escape(printable(step.title, 200)), total=None, step="")
            self._steps.update(self._running[key], step=escape(printable(step.words, 200)))
        self._write_head()
        if self.live and time.monotonic() - self._drawn > SECONDS:
            self._drawn = time.monotonic()
            self._live.refresh()

    def _write_head(self) -> None:
        ended, total, running = self._counts.total(), len(self._titles), len(self._running)
        failed = f", [red]{ended - self._counts[OK]} failed[/]" if ended > self._counts[OK] else ""
        words = f"{ended}/{total} done{failed}, {running} running, {max(total - ended - running, 0)} left"
        self._head.update(self._total, completed=ended, description=words, left=self._time_left())

    def _time_left(self) -> str:
        """``about 0:03:20 left``; "over" where no trial of some method has finished; "" while nothing is known.

        An unfinished trial is expected to take the mean of the finished ones of its method, else the mean of all.
        """
        if not (self._left and self._took and self._running):
            return ""
        means = {method: fmean(seconds) for method, seconds in self._took.items()}
        other = fmean(seconds for all_of in self._took.values() for seconds in all_of)
        elapsed = {task.id: task.elapsed or 0.0 for task in self._steps.tasks}
        spent = {key: elapsed[task_id] for key, task_id in self._running.items()}
        rest = [max(means.get(method, other) - spent.get(key, 0.0), 0.0) for key, method in self._left.items()]
        seconds = max(sum(rest) / len(self._running), *rest)
        word = "about" if means.keys() >= set(self._left.values()) else "over"
        return f"{word} {timedelta(seconds=round(seconds))} left"


def _text(format: str, ratio: int) -> TextColumn:
    """A column of text that is cut at the width that it gets."""
    return TextColumn(format, table_column=Column(ratio=ratio, no_wrap=True, overflow="ellipsis"))


def _words(title: str, outcome: Outcome) -> str:
    """``dance_yoga ours: e_3d 0.0318  wrong 0/116 (4.2 s)``; a failure begins with its status."""
    words = "  ".join(filter(None, [*brief(outcome.metrics, outcome.n_points), outcome.error]))
    mark = "" if outcome.status == OK else f"{outcome.status.upper()} "
    took = "" if outcome.seconds is None else f" ({outcome.seconds:.1f} s)"
    return f"{mark}{title}: {words}{took}"
