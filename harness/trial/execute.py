"""Run one trial: skip it if it is done, lock its folder, isolate it, and make sure that it leaves a record."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from filelock import FileLock, Timeout

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record import folder as storage
from nrsfm.harness.record.environment import COMPUTES, environment
from nrsfm.harness.record.outcome import ABSENT, FAILED, OK, Outcome
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.trial.identity import Identity, identify, packages_of
from nrsfm.harness.trial.isolation import Stopped, run_isolated
from nrsfm.harness.trial.progress import forget, place


class Busy(Exception):
    """Another process runs the trial at this moment."""


def execute(
    trial: Trial,
    settings: Settings,
    identity: Identity | None = None,
    title: str = "",
    *,
    old: str | None = None,
    again: bool = False,
    stopped: Callable[[], bool] = lambda: False,
    wait: bool = True,
) -> tuple[Outcome, bool]:
    """Run a trial unless it is done; returns its record and whether it ran.

    If two processes meet at one trial, the second waits for the first and then finds the trial done.

    Parameters
    ----------
    identity : Identity, optional
        If the data change after :func:`identify`, the trial fails instead of being recorded under the wrong key.
    title : str
        What the record and the progress call the trial; its own title by default.
    old : str, optional
        When the record that the sweep found at its start was finished, "" if there was none. A record with any other
        time is new and is not repeated, whatever ``settings.rerun`` says. Times are only compared for equality,
        because clocks differ between machines.
    again : bool
        Run the trial whatever record it has.
    stopped : callable
        Called several times a second; when it returns true the trial is killed, leaves no record, and
        :class:`~nrsfm.harness.trial.isolation.Stopped` is raised.
    wait : bool
        Wait for another process that runs the trial; otherwise Busy is raised.
    """
    identity = identity or identify(trial, settings)
    folder = settings.trials / identity.key

    def finished() -> Outcome | None:
        record = storage.read_record(folder)
        return None if record is None or again or repeats(record, trial, settings.rerun, old) else record

    if record := finished():
        return record, False
    folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder / ".lock", stopped, wait):
        if record := finished():
            return record, False
        (folder / storage.TRACEBACK).unlink(missing_ok=True)
        _run(trial, settings, identity, title or trial.title, folder, stopped)
        outcome = storage.read_record(folder)
        assert outcome is not None
        if outcome.status != OK:
            (folder / storage.ARRAYS).unlink(missing_ok=True)  # from an earlier run
        return outcome, True


def _run(
    trial: Trial, settings: Settings, identity: Identity, title: str, folder: Path, stopped: Callable[[], bool]
) -> None:
    """Run the trial in its own process; write its record here if that process could not."""
    start = time.monotonic()
    environment = {"threads": str(settings.threads), "packages": packages_of(trial), "data": identity.data}
    environment = {name: value for name, value in environment.items() if value}
    blank = Outcome.of_trial(trial, identity.key)
    blank = replace(blank, sweep=settings.sweep, title=title, environment=environment)
    if identity.reason:
        status = ABSENT if identity.absent else FAILED
        storage.write_record(folder, replace(blank, status=status, error=identity.reason))
        return
    step = place(settings.output, settings.sweep, identity.key)
    try:
        ended = run_isolated(
            "nrsfm.harness.trial.worker:work",
            (trial, blank, settings.data, settings.missing == "stand_in", folder, settings.memory_gb, step),
            seconds=settings.seconds,
            memory_gb=settings.memory_gb,
            threads=settings.threads,
            log=folder / storage.LOG,
            stopped=stopped,
        )
    finally:
        forget(step)
    if ended.status != OK:
        storage.check_space(folder)
        seconds = round(time.monotonic() - start, 4)
        storage.write_record(folder, replace(blank, status=ended.status, error=ended.detail, seconds=seconds))


@contextmanager
def _locked(path: Path, stopped: Callable[[], bool], wait: bool) -> Iterator[None]:
    """Hold a trial's lock; raises Busy or Stopped."""
    lock = FileLock(path)
    while True:
        try:
            lock.acquire(timeout=0.5 if wait else 0)
            break
        except Timeout:
            if not wait:
                raise Busy from None
            if stopped():
                raise Stopped from None
    try:
        yield
    finally:
        lock.release()


def repeats(record: Outcome, trial: Trial, rerun: str, old: str | None = None) -> bool:
    """Whether a trial with this record is to run again; never if the record is newer than the ``old`` one."""
    if old is not None and record.finished != old:
        return False
    if rerun == "stale":
        current = {**environment(), "packages": packages_of(trial)}
        return any(record.environment.get(name, "") != current[name] for name in COMPUTES)
    return rerun == "all" or (rerun == "failed" and record.status != OK)
