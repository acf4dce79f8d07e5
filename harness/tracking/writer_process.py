"""The process that writes trials to the tracker, so that a sweep waits neither for MLflow's imports nor its store."""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import os
import signal
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from nrsfm.harness.config.address import SECRETS, shown
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.tracking.tracker import Tracker, damage
from nrsfm.harness.trial.isolation import start_process, with_environment

if TYPE_CHECKING:
    from nrsfm.harness.config.settings import Settings

RETRY_AFTER = 5.0  # seconds between a failed write and the next try
SILENCE = 60.0  # seconds without a written trial, once the sweep is over, after which the tracker is given up
FINAL_TRIES = 2  # failed writes in a row, once the sweep is over, after which the tracker is given up
LIVES = 3  # how often the writer process may be lost

#: Connections to processes that have loaded MLflow and wait for a sweep; they end with this process.
_IDLE: list[Connection] = []


class Writer:
    """Writes trials to the tracker while the sweep goes on, in the order of :meth:`put`.

    While the tracker fails, one trial is tried every ``RETRY_AFTER`` seconds. A trial whose own files are damaged is
    left out. A writer process that is killed is started again. A trial is written once whatever happens, see
    :meth:`nrsfm.harness.tracking.tracker.Tracker.log`. For use by one thread.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._uri = shown(settings.tracking_uri)
        self._tracker_error = ""
        self._damaged = ""  # the first error of a trial's own files
        self._waiting: dict[str, None] = {}  # keys not written yet, in order
        self._sent: list[str] = []  # those that the process has, in order
        self._lives = LIVES
        self._next_try = 0.0
        self._last_answer = 0.0
        self._failures = 0  # in a row
        self._pipe: Connection | None = None

    @property
    def trouble(self) -> str:
        """Why some trials are not in the tracker; "" where all that were queued are."""
        return self._tracker_error or self._damaged

    def start(self) -> None:
        """Have the process open the store, without waiting for it."""
        prepare()
        self._pipe = _IDLE.pop()
        settings = self._settings
        variables = {name: os.environ.get(name) for name in SECRETS}
        try:
            self._pipe.send((settings.tracking_uri, settings.output, settings.trials, variables))
        except OSError:
            self._lost()

    def put(self, key: str) -> None:
        """Queue a trial."""
        self._waiting[key] = None
        self.tend()

    def tend(self) -> None:
        """Take in the process's answers and send it what is queued; returns at once."""
        self._receive(0)
        if self._waiting and not self._sent and time.monotonic() >= self._next_try:
            self._send(list(self._waiting)[: 1 if self._tracker_error else None])

    def finish(self) -> None:
        """Wait until every trial is written or the tracker is given up."""
        self._next_try, self._failures, self._last_answer = 0.0, 0, time.monotonic()
        while self._waiting and self._lives and self._failures < FINAL_TRIES:
            self.tend()
            self._receive(0.5)
            if time.monotonic() - self._last_answer > SILENCE:
                self._tracker_error = f"tracker {self._uri}: it took no trial for {SILENCE:g} s"
                break
        if self._pipe is not None and not self._sent:
            with contextlib.suppress(OSError):  # it was lost
                self._pipe.send(None)
                _IDLE.append(self._pipe)
        elif self._pipe is not None:
            self._pipe.close()
        self._pipe = None

    def _send(self, keys: list[str]) -> None:
        if self._pipe is None:
            self.start()
        if self._pipe is None:  # lost at once
            return
        try:
            self._pipe.send(keys)
            self._sent = keys
        except OSError:
            self._lost()

    def _receive(self, seconds: float) -> None:
        if self._pipe is None:
            time.sleep(seconds)
            return
        try:
            while self._pipe.poll(seconds):
                seconds = 0
                key, self._tracker_error, damaged = self._pipe.recv()
                self._last_answer = time.monotonic()
                self._damaged = self._damaged or damaged
                if self._tracker_error:  # the process has dropped what came after
                    self._sent = []
                    self._failures += 1
                    self._next_try = time.monotonic() + RETRY_AFTER
                    return
                self._sent.remove(key)
                del self._waiting[key]
                self._failures = 0
        except (OSError, EOFError):
            self._lost()

    def _lost(self) -> None:
        self._pipe = None
        if self._sent:  # what it was at goes behind the others, in case that is the cause
            del self._waiting[self._sent[0]]
            self._waiting[self._sent[0]] = None
        self._sent = []
        self._lives -= 1
        if not self._lives:
            self._tracker_error = f"tracker {self._uri}: its writer was lost {LIVES} times"


def prepare() -> None:
    """Start a writer process unless one is idle; it takes seconds to import MLflow, so this is done early."""
    if not _IDLE:
        pipe, child_end = multiprocessing.Pipe()
        start_process(_serve, child_end)
        child_end.close()
        _IDLE.append(pipe)


def _serve(pipe: Connection) -> None:
    """The process: writes for one sweep after the other, until the other end of the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(Exception):  # the tracker meets the error again, and explains it
        importlib.import_module("mlflow.store.tracking.sqlalchemy_store")
    with contextlib.suppress(EOFError, OSError):
        while True:
            uri, output, trials, variables = pipe.recv()
            with with_environment(variables):
                _serve_sweep(pipe, Tracker(uri, output), trials)


def _serve_sweep(pipe: Connection, tracker: Tracker, trials: Path) -> None:
    """Read lists of keys until None and answer each key with the tracker's error and the trial's, "" for none.

    An error of the tracker drops the rest of a list.
    """
    with contextlib.suppress(UsageError):
        _ = tracker.client
    while (keys := pipe.recv()) is not None:
        for key in keys:
            errors = _write(tracker, trials / key)
            pipe.send((key, *errors))
            if errors[0]:
                break


def _write(tracker: Tracker, folder: Path) -> tuple[str, str]:
    """Write one trial; what is wrong with the tracker or the disk, and what with the trial's files, on one line."""
    try:
        outcome = read_record(folder)
        if outcome is not None:
            tracker.log(outcome, folder)
    except (UsageError, OSError) as error:
        return " ".join(str(error).split()), ""
    except Exception as error:
        return "", damage(folder, error)
    return "", ""
