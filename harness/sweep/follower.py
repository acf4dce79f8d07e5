"""Follow a sweep while it runs: its journal feeds the progress line and the tracker."""

from __future__ import annotations

import sys
import threading
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from multiprocessing.connection import Connection
from types import TracebackType

from rich.console import Console

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.sweep.display import Display
from nrsfm.harness.tracking.tracker import Tracker
from nrsfm.harness.tracking.writer import Writer
from nrsfm.harness.trial.journal import Entry, entries, journal
from nrsfm.harness.trial.progress import steps


class Follower:
    """Context manager around a sweep: a thread that follows its journal.

    Workers leave records in trial folders and a line in the journal; this thread shows each as it appears and hands it
    to the tracker's writer, so workers never load MLflow nor wait for its store.

    Parameters
    ----------
    settings : Settings
    trials : mapping of str to Trial
        The trials of the sweep, by key.
    before : collection of str
        Keys of those that are done before it begins.
    ready : Connection, optional
        As of :class:`nrsfm.harness.tracking.writer.Writer`.

    ``entries`` holds what ended so far by key.
    """

    def __init__(
        self,
        settings: Settings,
        trials: Mapping[str, Trial],
        before: Collection[str],
        ready: Connection | None = None,
    ) -> None:
        self.settings = settings
        self.trials = trials
        self.entries: dict[str, Entry] = {}
        self._before = [key for key in trials if key in before]
        self._writer = Writer(settings, ready)
        self._tracker = Tracker(settings.tracking_uri, settings.output)
        path = journal(settings.output, settings.sweep)
        self._offset = path.stat().st_size if path.is_file() else 0  # a sweep of this name may have been before
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._loop, daemon=True)
        self._display = Display(trials, Console(stderr=True), live=sys.stderr.isatty())

    def __enter__(self) -> Follower:
        if len(self._before) < len(self.trials):
            self._writer.start()
        self._display.__enter__()
        self._found(self._before)
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self._stop.set()
        self._thread.join()
        self._display.__exit__(kind, error, tb)

    @property
    def counts(self) -> Counter[str]:
        """How many trials ended with each status, done before or now."""
        return Counter(entry.status for entry in self.entries.values())

    def _loop(self) -> None:
        while True:
            last = self._stop.is_set()
            self._drain()
            if self._display.live:
                self._display.running(dict(steps(self.settings.output, self.settings.sweep)))
            self._writer.tend()
            if last:
                break
            self._stop.wait(0.2)
        self._found(self.trials.keys() - self.entries.keys())
        for key, entry in self.entries.items():
            if not entry.ran and not self._held(key):
                self._writer.put(key)
        self._writer.finish()

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
                self._take(Entry(key, self.trials[key].title, outcome.status, ran))

    def _drain(self) -> None:
        path = journal(self.settings.output, self.settings.sweep)
        for entry, offset in entries(path, self._offset):
            self._offset = offset
            self._take(entry)

    def _take(self, entry: Entry) -> None:
        if entry.key not in self.trials or entry.key in self.entries:
            return
        self.entries[entry.key] = entry
        outcome = read_record(self.settings.trials / entry.key)
        if outcome is not None:
            self._display.ended(entry.key, outcome, ran=entry.ran)
        if entry.ran:
            self._writer.put(entry.key)
