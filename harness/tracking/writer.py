"""The tracker's writer: a process of its own, so that neither MLflow's time nor its end is the sweep's."""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import signal
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from nrsfm.harness.config.address import shown
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.tracking.tracker import Tracker
from nrsfm.harness.trial.isolation import start_process

if TYPE_CHECKING:
    from nrsfm.harness.config.settings import Settings


PATIENCE = 5.0  # seconds before a tracker that could not be written is tried again


SILENCE = 60.0  # seconds at the end without a trial written, after which a tracker counts as lost


TRIES = 2  # in a row, at the end


LIVES = 3  # of the process


class Writer:
    """Brings trials into the tracker, in the order in which they are put, while the sweep goes on.

    A tracker that is away is tried again now and then and at the end, with one trial, and a writer that is killed is
    started again; what was under way is written once, see :meth:`nrsfm.harness.tracking.tracker.Tracker.log`. To be used by one
    thread.

    Parameters
    ----------
    settings : Settings
    ready : Connection, optional
        To a process that :func:`prepare` has started; closed at the end, used or not.

    ``trouble`` says what keeps the tracker from being written, "" for nothing.
    """

    def __init__(self, settings: Settings, ready: Connection | None = None) -> None:
        self.trouble = ""
        self._settings = settings
        self._waiting: dict[str, None] = {}  # not written yet
        self._sent: set[str] = set()  # of those, what the process is at
        self._lives = LIVES
        self._again = 0.0
        self._heard = 0.0
        self._failures = 0  # in a row
        self._ready = ready
        self._pipe: Connection | None = None

    def start(self) -> None:
        """Have the process open the store while others do their work."""
        self._pipe, self._ready = self._ready or prepare(), None
        try:
            self._pipe.send((self._settings.tracking_uri, self._settings.output, self._settings.trials))
        except OSError:
            self._lost()

    def put(self, key: str) -> None:
        """Have a trial written."""
        self._waiting[key] = None
        self.tend()

    def tend(self) -> None:
        """Take in what was written and send what may be; waits for nothing."""
        self._receive(0)
        if self._waiting and not self._sent and time.monotonic() >= self._again:
            self._send(list(self._waiting)[: 1 if self.trouble else None])

    def finish(self) -> None:
        """Wait until everything is written, or the tracker does not take it."""
        self._again, self._failures, self._heard = 0.0, 0, time.monotonic()
        while self._waiting and self._lives and self._failures < TRIES:
            self.tend()
            self._receive(0.5)
            if time.monotonic() - self._heard > SILENCE:
                self.trouble = f"tracker {shown(self._settings.tracking_uri)}: it took no trial for {SILENCE:g} s"
                break
        for pipe in (self._pipe, self._ready):
            if pipe is not None:
                pipe.close()

    def _send(self, keys: list[str]) -> None:
        if self._pipe is None:
            self.start()
        if self._pipe is None:  # it was lost at once
            return
        try:
            self._pipe.send(keys)
            self._sent.update(keys)
        except OSError:
            self._lost()

    def _receive(self, seconds: float) -> None:
        if self._pipe is None:
            time.sleep(seconds)
            return
        try:
            while self._pipe.poll(seconds):
                seconds = 0
                key, self.trouble = self._pipe.recv()
                self._heard = time.monotonic()
                del self._waiting[key]
                self._sent.discard(key)
                self._failures = self._failures + 1 if self.trouble else 0
                if self.trouble:  # then the process has put down the rest as well
                    self._waiting[key] = None  # behind the others, should it be this trial's own fault
                    self._sent.clear()
                    self._again = time.monotonic() + PATIENCE
                    return
        except (OSError, EOFError):
            self._lost()

    def _lost(self) -> None:
        self._pipe = None
        self._sent.clear()
        self._lives -= 1
        if not self._lives:
            self.trouble = f"tracker {shown(self._settings.tracking_uri)}: its writer was lost {LIVES} times"


def prepare() -> Connection:
    """Start a process that loads MLflow, which takes seconds, while it is found out what there is to write."""
    pipe, theirs = multiprocessing.Pipe()
    start_process(_serve, theirs)
    theirs.close()
    return pipe


def _serve(pipe: Connection) -> None:
    """The process: keys in, what was in the way of each out, until one fails; ends with who holds the other end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    importlib.import_module("mlflow.store.tracking.sqlalchemy_store")
    with contextlib.suppress(EOFError, OSError):
        uri, output, trials = pipe.recv()
        tracker = Tracker(uri, output)
        with contextlib.suppress(UsageError):
            _ = tracker.client
        while True:
            for key in pipe.recv():
                trouble = _write(tracker, trials / key)
                pipe.send((key, trouble))
                if trouble:
                    break


def _write(tracker: Tracker, folder: Path) -> str:
    try:
        outcome = read_record(folder)
        if outcome is not None:
            tracker.log(outcome, folder)
    except (UsageError, OSError) as error:
        return " ".join(str(error).split())
    return ""
