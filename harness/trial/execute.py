from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from filelock import FileLock, Timeout

from nrsfm.datasets import registry as datasets
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record import folder as storage
from nrsfm.harness.record.environment import COMPUTES, environment
from nrsfm.harness.record.outcome import ABSENT, FAILED, OK, Outcome
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.trial.isolation import Stopped, run_isolated
from nrsfm.harness.trial.packages import packages_of
from nrsfm.harness.trial.progress import forget, place
from nrsfm.methods.base import MethodError
from nrsfm.methods.registry import build_method, version


def identify(trial: Trial, settings: Settings) -> tuple[str, DatasetError | MethodError | None]:
    """The trial's key, and why it cannot run (None when it can)."""
    key, reason, _ = _identity(trial, settings)
    return key, reason


def _identity(trial: Trial, settings: Settings) -> tuple[str, DatasetError | MethodError | None, str]:
    """:func:`identify`, and the digest of the data, "" where they cannot be had."""
    try:
        data = datasets.digest(trial.dataset, settings.data, settings.missing == "stand_in")
        method = build_method({k: v for k, v in trial.method.items() if k != "name"})
    except (DatasetError, MethodError) as error:
        return trial.key("unavailable", str(error)), error, ""
    return trial.key(data, version(method)), None, data


class Busy(Exception):
    """Somebody else is at work on the trial."""


def execute(
    trial: Trial,
    settings: Settings,
    *,
    old: str | None = None,
    again: bool = False,
    stopped: Callable[[], bool] = lambda: False,
    wait: bool = True,
) -> tuple[Outcome, bool]:
    """Run a trial unless it is done, and return its record and whether it ran.

    Two processes that meet at one trial wait for each other, and the second finds it done.

    Parameters
    ----------
    trial : Trial
    settings : Settings
    old : str, optional
        When the record that the sweep found was finished, "" if there was none: any other record is new, whatever
        ``settings.rerun`` says. Told by what it says and not by its age, for clocks of machines differ.
    again : bool
        Run it whatever record it has.
    stopped : callable
        Asked now and then; once true, the trial ends and leaves no record.
    wait : bool
        For somebody else at work on the trial.

    Raises
    ------
    Busy
        If somebody else is at work on the trial and ``wait`` is false.
    nrsfm.harness.trial.isolation.Stopped
        If it was to end before it was done.
    OSError
        If its files cannot be written.
    """
    key, reason, data = _identity(trial, settings)
    folder = settings.trials / key
    before = storage.read_record(folder)
    if before is not None and not (again or repeats(before, trial, settings.rerun, old)):
        return before, False
    folder.mkdir(parents=True, exist_ok=True)
    with _own(folder / ".lock", stopped, wait):
        before = storage.read_record(folder)
        if before is not None and not (again or repeats(before, trial, settings.rerun, old)):
            return before, False
        (folder / storage.TRACEBACK).unlink(missing_ok=True)
        start = time.monotonic()
        blank = _blank(trial, key, data, settings)
        if reason:
            status = ABSENT if isinstance(reason, MissingData) else FAILED
            storage.write_record(folder, replace(blank, status=status, error=str(reason)))
        else:
            stand_in = settings.missing == "stand_in"
            running = place(settings.output, settings.sweep, key)
            try:
                ended = run_isolated(
                    "nrsfm.harness.trial.worker:work",
                    (trial, blank, settings.data, stand_in, folder, settings.memory_gb, running),
                    seconds=settings.seconds,
                    memory_gb=settings.memory_gb,
                    threads=settings.threads,
                    log=folder / storage.LOG,
                    stopped=stopped,
                )
            finally:
                forget(running)
            if ended.status != OK:
                storage.check_space(folder)
                seconds = round(time.monotonic() - start, 4)
                storage.write_record(folder, replace(blank, status=ended.status, error=ended.detail, seconds=seconds))
        outcome = storage.read_record(folder)
        assert outcome is not None
        if outcome.status != OK:
            (folder / storage.ARRAYS).unlink(missing_ok=True)  # of an earlier run
        return outcome, True


@contextmanager
def _own(path: Path, stopped: Callable[[], bool], wait: bool) -> Iterator[None]:
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


def repeats(before: Outcome, trial: Trial, rerun: str, old: str | None = None) -> bool:
    """Whether a trial with this record is to run again: never if the record is another than the ``old`` one."""
    if old is not None and before.finished != old:
        return False
    if rerun == "stale":
        here = {**environment(), "packages": packages_of(trial)}
        return any(before.environment.get(name, "") != here[name] for name in COMPUTES)
    return rerun == "all" or (rerun == "failed" and before.status != OK)


def _blank(trial: Trial, key: str, data: str, settings: Settings) -> Outcome:
    """What is known of an outcome before the trial runs, the digest of its data among it."""
    environment = {"threads": str(settings.threads), "packages": packages_of(trial), "data": data}
    placement = trial.dataset.get("placement", "")
    return Outcome(
        key=key,
        setting=trial.setting,
        status=FAILED,
        dataset=str(trial.dataset["name"]),
        method=str(trial.method["name"]),
        cameras=str(trial.cameras["source"]),
        placement=placement if isinstance(placement, str) else json.dumps([float(x) for x in placement]),
        motion=str(trial.dataset.get("motion", "")),
        level=float(trial.noise["level"]),
        repeat=int(trial.noise["repeat"]),
        n_bodies=trial.n_bodies if isinstance(trial.n_bodies, int) else None,
        sweep=settings.sweep,
        parameters={
            "dataset": dict(trial.dataset),
            "method": dict(trial.method),
            "cameras": dict(trial.cameras),
            "noise": dict(trial.noise),
            "gaps": dict(trial.gaps),
        },
        environment={name: value for name, value in environment.items() if value},
    )
