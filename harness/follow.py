"""Follow a sweep while it runs: its journal feeds the progress line and the tracker."""

from __future__ import annotations

import sys
import threading
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from harness.experiments import Settings
from harness.record import OK
from harness.running import steps
from harness.storage import read_record
from harness.tracking import Tracker
from harness.trial import Entry, entries, journal
from harness.writer import Writer
from reports.text import printable


class Follower:
    """Context manager around a sweep: a thread that follows its journal.

    Workers leave records in trial folders and a line in the journal; this thread shows each as it appears and hands it
    to the tracker's writer, so workers never load MLflow nor wait for its store.

    Parameters
    ----------
    settings : Settings
    titles : mapping of str to str
        The trials of the sweep, title by key.
    before : collection of str
        Keys of those that are done before it begins.

    ``entries`` holds what ended so far by key.
    """

    def __init__(self, settings: Settings, titles: Mapping[str, str], before: Collection[str]) -> None:
        self.settings = settings
        self.titles = titles
        self.entries: dict[str, Entry] = {}
        self._before = [key for key in titles if key in before]
        self._writer = Writer(settings)
        self._tracker = Tracker(settings.tracking_uri, settings.output)
        path = journal(settings.output, settings.sweep)
        self._offset = path.stat().st_size if path.is_file() else 0  # a sweep of this name may have been before
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._loop, daemon=True)
        self._console = Console(stderr=True)
        self._bars: dict[str, TaskID] = {}
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=self._console,
            disable=not sys.stderr.isatty(),
        )
        self._task = self._progress.add_task("trials", total=len(titles))

    def __enter__(self) -> Follower:
        if len(self._before) < len(self.titles):
            self._writer.start()
        self._progress.start()
        self._found(self._before)
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self._stop.set()
        self._thread.join()
        self._progress.stop()

    @property
    def counts(self) -> Counter[str]:
        """How many trials ended with each status, done before or now."""
        return Counter(entry.status for entry in self.entries.values())

    def _loop(self) -> None:
        while True:
            last = self._stop.is_set()
            self._drain()
            self._show()
            self._writer.tend()
            if last:
                break
            self._stop.wait(0.2)
        self._found(self.titles.keys() - self.entries.keys())
        for key, entry in self.entries.items():
            if not entry.ran and not self._held(key):
                self._writer.put(key)
        self._writer.finish()

    def _show(self) -> None:
        """A bar for each trial at work, with its residuals."""
        found = dict(steps(self.settings.output, self.settings.sweep)) if self._console.is_terminal else {}
        for key in self._bars.keys() - found.keys():
            self._progress.remove_task(self._bars.pop(key))
        for key, step in found.items():
            if key not in self._bars:
                self._bars[key] = self._progress.add_task("")
            self._progress.update(
                self._bars[key],
                total=step.iterations,
                completed=step.iteration,
                description=escape(printable(step.words, 200)),
            )

    @property
    def trouble(self) -> str:
        """What keeps the tracker from being written, "" for nothing."""
        return self._writer.trouble

    def _held(self, key: str) -> bool:
        folder = self.settings.trials / key
        outcome = read_record(folder)
        return outcome is not None and self._tracker.holds(outcome, folder)

    def _found(self, keys: Iterable[str]) -> None:
        """Take in trials of no journal: done before, by a sweep beside this one, or by a worker that was lost."""
        for key in keys:
            outcome = read_record(self.settings.trials / key)
            if outcome is not None:
                ran = key not in self._before and outcome.sweep == self.settings.sweep
                self._take(Entry(key, self.titles[key], outcome.status, ran))

    def _drain(self) -> None:
        path = journal(self.settings.output, self.settings.sweep)
        for entry, offset in entries(path, self._offset):
            self._offset = offset
            self._take(entry)

    def _take(self, entry: Entry) -> None:
        if entry.key in self.titles and entry.key not in self.entries:
            self.entries[entry.key] = entry
            failed = sum(n for status, n in self.counts.items() if status != OK)
            self._progress.update(
                self._task, advance=1, description=f"trials [red]{failed} failed[/red]" if failed else "trials"
            )
            if entry.ran or entry.status != OK:
                self._say(entry)
            if entry.ran:
                self._writer.put(entry.key)

    def _say(self, entry: Entry) -> None:
        outcome = read_record(self.settings.trials / entry.key)
        if outcome is None:
            return
        shown = {name: outcome.metrics[name] for name in ("e_3d", "e_3d_dai") if name in outcome.metrics}
        words = [f"{name} {value:.4f}" for name, value in shown.items()]
        if "n_wrong" in outcome.metrics:
            words.append(f"wrong {outcome.metrics['n_wrong']:.0f}/{outcome.n_points}")
        words.append(outcome.error)
        mark = "" if outcome.status == OK else f"{outcome.status.upper()} "
        said = f"[{len(self.entries)}/{len(self.titles)}] {mark}{entry.title}: {'  '.join(w for w in words if w)} "
        said += "" if outcome.seconds is None else f"({outcome.seconds:.1f} s)"
        self._console.print(printable(said), markup=False, highlight=False, soft_wrap=True)
