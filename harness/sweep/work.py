"""The work of a sweep: the jobs that its workers share, when they stop, and how one worker goes through them.

The process that was started composes a sweep once and writes it into the sweep's folder. Workers, whatever launcher
starts them, each take the next trial that no other process runs. So neither a slow trial, nor a lost worker, nor a
second sweep on the same output folder blocks the others.
"""

from __future__ import annotations

import json
import os
import socket
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import psutil
from annotated_types import Gt

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import read_record, write_text
from nrsfm.harness.record.outcome import OOM, Outcome
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.record.untrusted import checked
from nrsfm.harness.trial.execute import Busy, execute, repeats
from nrsfm.harness.trial.identity import Identity
from nrsfm.harness.trial.isolation import Stopped
from nrsfm.harness.trial.journal import Entry, note

KILLED = ("killed by SIGKILL", "the process was killed, or lost")  # from outside, as the kernel does without memory


@dataclass(frozen=True)
class Job:
    """A trial of a sweep, its settings and its identity.

    ``old`` is when the record that the sweep found was finished, "" where there was none; any other record is new.
    ``title`` tells the trial from the sweep's others.
    """

    trial: Trial
    settings: Settings
    identity: Identity
    old: str = ""
    title: str = ""

    @property
    def record(self) -> Outcome | None:
        """The trial's record as it is now."""
        return read_record(self.settings.trials / self.identity.key)

    @property
    def due(self) -> bool:
        """Whether the trial still has to run in this sweep."""
        record = self.record
        return record is None or repeats(record, self.trial, self.settings.rerun, self.old)

    @property
    def stale(self) -> bool:
        """Whether the trial's record was computed by other code or other libraries."""
        record = self.record
        return record is not None and repeats(record, self.trial, "stale")


@dataclass(frozen=True)
class Work:
    """The jobs that the workers of one attempt at a sweep go through.

    ``path`` is its file; a file of the same name with the suffix ``.stop`` tells the workers to end. Trials that still
    run at the time ``until``, in seconds since 1970, are stopped. ``host`` and ``pid`` are those of the sweep's own
    process; workers on the same host end when it does.
    """

    path: Path
    jobs: Sequence[Job]
    until: float
    host: str
    pid: Annotated[int, Gt(0)]

    @classmethod
    def begin(cls, path: Path, jobs: Sequence[Job], until: float) -> Work:
        """Write the file from which workers read their jobs, without the tracker's address, which may hold a login."""
        plain = [replace(job, settings=replace(job.settings, tracking_uri="")) for job in jobs]
        work = cls(path, plain, until, _host(), os.getpid())
        write_text(path, json.dumps(asdict(work), default=str))
        return work

    @classmethod
    def read(cls, path: Path) -> Work:
        """Read the file that :meth:`begin` wrote; raises UsageError if it is not one."""
        try:
            return replace(checked(cls, path.read_bytes()), path=path)
        except ValueError as error:
            raise UsageError(f"{path} is no list of trials ({one_line(error)}); start the sweep again") from None

    def end(self) -> None:
        """Make every worker stop, on whatever machine it runs."""
        self._mark.touch()

    def clear(self) -> None:
        """Remove the files, when no worker is left."""
        self.path.unlink(missing_ok=True)
        self._mark.unlink(missing_ok=True)

    def over(self) -> bool:
        """Whether the workers are to stop."""
        return time.time() > self.until or self._mark.exists()

    @property
    def _mark(self) -> Path:
        return self.path.with_suffix(".stop")


def go_through(work: Work) -> None:
    """Run, one after the other, the jobs that are not done and that no other worker runs.

    Trials that another worker runs, and killed ones that may be tried again, come last.
    """
    _end_with(work)
    tries: dict[int, int] = {}
    turn = [(i, False) for i in range(len(work.jobs))]
    while turn:
        later = []
        for i, wait in turn:
            if work.over():
                return
            job = work.jobs[i]
            trial, settings = job.trial, job.settings
            try:
                record, ran = execute(
                    trial,
                    settings,
                    job.identity,
                    job.title,
                    old=job.old,
                    again=i in tries,
                    stopped=work.over,
                    wait=wait,
                )
            except Busy:
                later.append((i, True))
                continue
            except Stopped:
                return
            if not ran:
                continue
            tries[i] = tries.get(i, 0) + 1
            if tries[i] <= settings.retries and (record.status == OOM or any(w in record.error for w in KILLED)):
                later.append((i, True))
            else:
                note(settings, Entry(record.key, job.title, record.status, ran=True))
        turn = later


def _host() -> str:
    """This machine, or this job of a cluster on it."""
    return f"{socket.gethostname()}:{os.environ.get('SLURM_JOB_ID', '')}"


def _end_with(work: Work) -> None:
    """End this process when the sweep's own process is gone, if that runs on the same host."""
    if work.pid == os.getpid() or work.host != _host():
        return

    def watch() -> None:
        try:
            process = psutil.Process(work.pid)
            while process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
                time.sleep(0.5)
        except psutil.NoSuchProcess:
            pass
        os._exit(1)

    name = f"end with {work.pid}"
    if not any(thread.name == name for thread in threading.enumerate()):
        threading.Thread(target=watch, name=name, daemon=True).start()
