"""Follow a sweep's journal while it runs, and pass each finished trial to the display and to the tracker."""

from __future__ import annotations

import sys
import threading
from collections.abc import Collection, Iterable, Mapping
from types import TracebackType

from rich.console import Console

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.sweep.display import Display
from nrsfm.harness.sweep.work import Job
from nrsfm.harness.tracking.tracker import Tracker
from nrsfm.harness.tracking.writer_process import Writer
from nrsfm.harness.trial.journal import Entry, entries, journal
from nrsfm.harness.trial.progress import steps


class Follower:
    """Context manager around a sweep, with a thread that reads its journal.

    Workers leave records in trial folders and lines in the journal. The thread shows each finished trial and passes it
    to the tracker's writer, so that workers neither load MLflow nor wait for its store. ``jobs`` are those of the
    sweep, by key; those of the keys ``before`` are done when it begins. ``entries`` holds the ended ones, by key.
    """

    def __init__(self, settings: Settings, jobs: Mapping[str, Job], before: Collection[str]) -> None:
        self.settings = settings
        self.jobs = jobs
        self.entries: dict[str, Entry] = {}
        self._before = [key for key in jobs if key in before]
        self._writer = Writer(settings)
        self._tracker = Tracker(settings.tracking_uri, settings.output)
        self._journal = journal(settings.output, settings.sweep)
        self._offset = self._journal.stat().st_size if self._journal.is_file() else 0  # of an earlier sweep's lines
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._loop, daemon=True)
        self._display = Display(
            {key: job.trial for key, job in jobs.items()}, Console(stderr=True), live=sys.stderr.isatty()
        )

    def __enter__(self) -> Follower:
        if len(self._before) < len(self.jobs):
            self._writer.start()
        self._display.__enter__()
        self._take_records(self._before)
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self._stop.set()
        self._thread.join()
        self._display.__exit__(kind, error, tb)

    def _loop(self) -> None:
        while True:
            last = self._stop.is_set()
            for entry, offset in entries(self._journal, self._offset):
                self._offset = offset
                self._take(entry)
            if self._display.live:
                self._display.update(dict(steps(self.settings.output, self.settings.sweep)))
            self._writer.tend()
            if last:
                break
            self._stop.wait(0.2)
        self._take_records(self.jobs.keys() - self.entries.keys())
        for key, entry in self.entries.items():
            folder = self.settings.trials / key
            if not entry.ran and not ((record := read_record(folder)) and self._tracker.holds(record, folder)):
                self._writer.put(key)
        self._writer.finish()

    @property
    def trouble(self) -> str:
        """What keeps trials from the tracker, "" for nothing."""
        return self._writer.trouble

    def _take_records(self, keys: Iterable[str]) -> None:
        """Enter trials without a line in the journal: done before, by a concurrent sweep, or by a worker that died."""
        for key in keys:
            outcome = read_record(self.settings.trials / key)
            if outcome is not None:
                ran = key not in self._before and outcome.sweep == self.settings.sweep
                self._take(Entry(key, self.jobs[key].title, outcome.status, ran))

    def _take(self, entry: Entry) -> None:
        if entry.key not in self.jobs or entry.key in self.entries:
            return
        self.entries[entry.key] = entry
        outcome = read_record(self.settings.trials / entry.key)
        if outcome is not None:
            self._display.ended(entry.key, outcome, ran=entry.ran)
        if entry.ran:
            self._writer.put(entry.key)
