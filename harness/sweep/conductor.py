"""Carry out a sweep, from its overrides to a record for every trial.

The code is called in one direction: the conductor identifies the trials and starts a launcher, the launcher starts
workers, each worker goes through the shared work, ``execute`` runs one trial of it apart, and ``worker`` is what
happens in that process. Results come back as files: records, and lines in the sweep's journal.
"""

from __future__ import annotations

import secrets
import signal
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import Request
from nrsfm.harness.record.folder import check_space, read_record
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.trial import titles
from nrsfm.harness.sweep.follower import Follower
from nrsfm.harness.sweep.launcher import Launcher
from nrsfm.harness.sweep.work import Job, Work
from nrsfm.harness.tracking.writer_process import prepare
from nrsfm.harness.trial.identity import identify
from nrsfm.harness.trial.isolation import start_server
from nrsfm.harness.trial.journal import Entry, journal
from nrsfm.harness.trial.progress import steps
from nrsfm.harness.trial.signals import on_signals

ATTEMPTS = 3  # consecutive attempts that may end without any trial done
STOP_SECONDS = 5.0  # that the workers of an interrupted sweep get to stop their trials


@dataclass(frozen=True)
class Sweep:
    """A sweep that has ended: its trials by key, and those of them that have a record."""

    settings: Settings
    jobs: Mapping[str, Job]
    entries: Mapping[str, Entry]
    #: What ended the sweep before all trials were done, "" for nothing.
    trouble: str
    #: What kept trials from the tracker, "" for nothing.
    tracking_trouble: str

    @property
    def counts(self) -> Counter[str]:
        """How many trials ended with each status, in this sweep or before."""
        return Counter(entry.status for entry in self.entries.values())


def conduct(request: Request) -> Sweep:
    """Run every trial of a request that is not done.

    Raises UsageError if the launcher cannot be used: nothing has run then.
    """
    if len(list(request.settings.trials.glob("*/"))) < len(request.trials):  # some trial is due
        start_server()  # libraries load while the trials are identified
        prepare()
    sweep = request.settings.sweep or f"{datetime.now():%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"
    jobs: dict[str, Job] = {}
    names = titles([trial for trial, _ in request.trials])
    for (trial, settings), title in zip(request.trials, names, strict=True):
        identity = identify(trial, settings)
        record = read_record(settings.trials / identity.key)
        old = record.finished if record else ""
        jobs[identity.key] = Job(trial, replace(settings, sweep=sweep), identity, old, title)
    settings = next(iter(jobs.values())).settings
    launcher = Launcher(request)
    journal(settings.output, sweep).parent.mkdir(parents=True, exist_ok=True)
    left = [job for job in jobs.values() if job.due]
    done = jobs.keys() - {job.identity.key for job in left}
    with on_signals(signal.SIGTERM, do=signal.default_int_handler), Follower(settings, jobs, done) as follower:
        trouble = _run_all(left, settings, launcher)
    return Sweep(settings, jobs, follower.entries, trouble, follower.trouble)


def _run_all(left: Sequence[Job], settings: Settings, launcher: Launcher) -> str:
    """Start workers until every job is done; returns what prevented that, or "".

    An attempt may end early, as when a worker is killed; the next one runs the rest.
    """
    folder = journal(settings.output, settings.sweep).parent
    until, fruitless, trouble = time.time() + settings.sweep_seconds, 0, ""
    while left and fruitless < ATTEMPTS and time.time() < until:
        work = Work.begin(folder / f"{secrets.token_hex(4)}.work", left, until)
        try:
            launcher.launch(work)
            trouble = ""
        except Exception as error:
            trouble = f"the sweep ended early ({type(error).__name__}: {one_line(error, 200)})"
        except BaseException:
            work.end()
            _await_stop(work)
            raise
        work.clear()
        still = [job for job in left if job.due]
        fruitless = fruitless + 1 if len(still) == len(left) else 0
        left = still
        try:
            check_space(folder)  # a worker's error may not say that the disk is full
        except OSError as error:
            trouble, fruitless = f"{error.filename}: {error.strerror}; make room", ATTEMPTS
    if not left:
        return ""
    if time.time() >= until:
        return f"its {settings.sweep_seconds:g} s are over"
    return trouble or "its workers were lost"


def _await_stop(work: Work) -> None:
    """Wait until no worker runs a trial, so that the last records are there when the tracker is completed."""
    keys = {job.identity.key for job in work.jobs}
    settings = work.jobs[0].settings
    end = time.monotonic() + STOP_SECONDS
    while time.monotonic() < end and any(key in keys for key, _ in steps(settings.output, settings.sweep)):
        time.sleep(0.1)
