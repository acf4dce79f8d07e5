from __future__ import annotations

import os
import secrets
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from multiprocessing.connection import Connection
from pathlib import Path

import hydra
from omegaconf import DictConfig

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import Request
from nrsfm.harness.record.folder import check_space, read_record
from nrsfm.harness.sweep.follower import Follower
from nrsfm.harness.sweep.launcher import Launcher
from nrsfm.harness.sweep.work import Job, Work, go_through
from nrsfm.harness.trial.execute import identify, repeats
from nrsfm.harness.trial.journal import Entry, journal

ATTEMPTS = 3  # in a row that may end early without a trial done


@dataclass(frozen=True)
class Sweep:
    """A sweep that has ended: its jobs and those with a record by key, and what prevented the rest."""

    settings: Settings
    jobs: Mapping[str, Job]
    entries: Mapping[str, Entry]
    trouble: str
    tracking_trouble: str

    @property
    def counts(self) -> Counter[str]:
        """How many trials ended with each status, in this sweep or before."""
        return Counter(entry.status for entry in self.entries.values())


def conduct(request: Request, writer: Connection) -> Sweep:
    """Run every trial of a request that is not done.

    Raises
    ------
    UsageError
        If the launcher cannot be used; nothing has run then.
    OSError
        If the output folder cannot be written.
    """
    sweep = request.settings.sweep or f"{datetime.now():%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"
    jobs: dict[str, Job] = {}
    for trial, own in request.trials:
        key = identify(trial, own)[0]
        if key not in jobs:
            record = read_record(own.trials / key)
            jobs[key] = Job(trial, replace(own, sweep=sweep), record.finished if record else "")
    settings = next(iter(jobs.values())).settings
    launcher = Launcher(request, settings)

    def missing() -> dict[str, Job]:
        records = {key: read_record(settings.trials / key) for key in jobs}

        def again(key: str, job: Job) -> bool:
            outcome = records[key]
            return outcome is None or repeats(outcome, job.trial, job.settings.rerun, job.old)

        return {key: job for key, job in jobs.items() if again(key, job)}

    journal(settings.output, sweep).parent.mkdir(parents=True, exist_ok=True)
    trials = {key: job.trial for key, job in jobs.items()}
    with _interruptible(), Follower(settings, trials, jobs.keys() - missing().keys(), writer) as follower:
        trouble = _carry_out(missing, settings, launcher)
    return Sweep(settings, jobs, follower.entries, trouble, follower.trouble)


@hydra.main(config_path="pkg://nrsfm.conf", config_name="config", version_base="1.3")
def job(cfg: DictConfig) -> None:
    """One worker of a sweep: a Hydra job, whatever the launcher."""
    path = Path(cfg.work)
    if path.is_file():  # otherwise the sweep is over
        go_through(Work.read(path))


def _carry_out(missing: Callable[[], dict[str, Job]], settings: Settings, launcher: Launcher) -> str:
    """Start workers until nothing is missing; what was in the way, or "".

    An attempt may end early, as when a worker is killed; the next runs the rest.
    """
    folder = journal(settings.output, settings.sweep).parent
    until, lost, trouble = time.time() + settings.sweep_seconds, 0, ""
    left = missing()
    while left and lost < ATTEMPTS and time.time() < until:
        work = Work.begin(folder / f"{secrets.token_hex(4)}.work", list(left.values()), until)
        try:
            trouble = _attempt(work, launcher)
        except BaseException:
            work.end()
            raise
        work.clear()
        still = missing()
        left, lost = still, lost + 1 if len(still) == len(left) else 0
        try:
            check_space(folder)  # however a worker's error came here
        except OSError as error:
            trouble, lost = f"{error.filename}: {error.strerror}; make room", ATTEMPTS
    if not left:
        return ""
    return f"its {settings.sweep_seconds:g} s are over" if time.time() >= until else trouble or "its workers were lost"


@contextmanager
def _interruptible() -> Iterator[None]:
    """End on SIGTERM as on Ctrl-C: workers are told, what was finished is kept."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _attempt(work: Work, launcher: Launcher) -> str:
    """Have workers go through the work; what ended them early, or ""."""
    try:
        launcher.launch(work, call_hydra)
    except Exception as error:
        return f"the sweep ended early ({type(error).__name__}: {' '.join(str(error).split())[:200]})"
    return ""


def call_hydra(argv: list[str]) -> int:
    """Hydra's own command line; its exit code. Its errors are raised, not printed."""
    before = sys.argv
    sys.argv = ["nrsfm run", *argv]
    os.environ["HYDRA_FULL_ERROR"] = "1"
    try:
        job()
    except SystemExit as stop:
        return int(stop.code or 0)
    finally:
        sys.argv = before
    return 0
