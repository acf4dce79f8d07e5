"""The tracker's writer: a process of its own, so that neither MLflow's time nor its end is the sweep's."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import time
from multiprocessing.connection import Connection
from pathlib import Path

from harness.experiments import Settings
from harness.isolation import start_process
from harness.record import UsageError
from harness.storage import read_record
from harness.tracking import Tracker, shown

PATIENCE = 5.0  # seconds before a tracker that could not be written is tried again
LIVES = 3  # of the process


class Writer:
    """Brings trials into the tracker, in the order in which they are put, while the sweep goes on.

    A tracker that is away is tried again now and then and at the end, and a writer that is killed is started again;
    what was under way is written once, see :meth:`harness.tracking.Tracker.log`. To be used by one thread.

    Parameters
    ----------
    settings : Settings

    ``trouble`` says what keeps the tracker from being written, "" for nothing.
    """

    def __init__(self, settings: Settings) -> None:
        self.trouble = ""
        self._settings = settings
        self._waiting: dict[str, None] = {}  # not written yet
        self._sent: set[str] = set()
        self._lives = LIVES
        self._again = 0.0
        self._pipe: Connection | None = None

    def start(self) -> None:
        """Start the process, which loads MLflow and opens the store while others do their work."""
        self._pipe, theirs = multiprocessing.Pipe()
        start_process(_serve, theirs, self._settings.tracking_uri, self._settings.output, self._settings.trials)
        theirs.close()

    def put(self, key: str) -> None:
        """Have a trial written."""
        self._waiting[key] = None
        self.tend()

    def tend(self) -> None:
        """Take in what was written and send what may be; waits for nothing."""
        self._receive(0)
        if self.trouble and time.monotonic() < self._again:
            return
        for key in [key for key in self._waiting if key not in self._sent]:
            self._send(key)
            if self.trouble:  # one trial to try it with
                break

    def finish(self) -> None:
        """Wait until everything is written, or the tracker does not take it."""
        self._again = 0.0
        while self._waiting and self._lives:
            self.tend()
            if self._sent:
                self._receive(0.5)
            if self.trouble and not self._sent and self._again:
                break
        if self._pipe is not None:
            self._pipe.close()

    def _send(self, key: str) -> None:
        if self._pipe is None:
            self.start()
        assert self._pipe is not None
        try:
            self._pipe.send(key)
            self._sent.add(key)
        except OSError:
            self._lost()

    def _receive(self, seconds: float) -> None:
        try:
            while self._pipe is not None and self._pipe.poll(seconds):
                key, trouble = self._pipe.recv()
                self._sent.discard(key)
                self.trouble = trouble
                if trouble:
                    self._again = time.monotonic() + PATIENCE
                else:
                    self._waiting.pop(key, None)
        except (OSError, EOFError):
            self._lost()

    def _lost(self) -> None:
        self._pipe = None
        self._sent.clear()
        self._lives -= 1
        if not self._lives:
            self.trouble = f"tracker {shown(self._settings.tracking_uri)}: its writer was lost {LIVES} times"


def _serve(pipe: Connection, uri: str, output: Path, trials: Path) -> None:
    """The process: keys in, what was in the way of each out; ends with whoever holds the other end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tracker = Tracker(uri, output)
    with contextlib.suppress(UsageError):
        _ = tracker.client
    with contextlib.suppress(EOFError, OSError):
        while True:
            key = pipe.recv()
            pipe.send((key, _write(tracker, trials / key)))


def _write(tracker: Tracker, folder: Path) -> str:
    try:
        outcome = read_record(folder)
        if outcome is not None:
            tracker.log(outcome, folder)
    except UsageError as error:
        return str(error)
    except Exception as error:
        reason = " ".join(str(error).split())[:300]
        return f"tracker {shown(tracker.uri)}: {type(error).__name__}: {reason}"
    return ""
