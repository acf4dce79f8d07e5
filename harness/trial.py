"""The outside of a trial: is it done already, run it apart, see to its record whatever happens."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from filelock import FileLock

from datasets import registry as datasets
from datasets.body import DatasetError, MissingData
from harness import storage
from harness.experiments import Settings
from harness.isolation import run_isolated
from harness.record import ABSENT, FAILED, OK, Outcome, Trial
from harness.running import place
from methods.base import MethodError
from methods.registry import build_method, version


@dataclass(frozen=True)
class Entry:
    """One line of a sweep's journal: the trial that ended and whether it ran now or was done before."""

    key: str
    title: str
    status: str
    ran: bool


def identify(trial: Trial, settings: Settings) -> tuple[str, DatasetError | MethodError | None]:
    """The trial's key, and why it cannot run (None when it can)."""
    try:
        data = datasets.digest(trial.dataset, settings.data, settings.missing == "stand_in")
        method = build_method({k: v for k, v in trial.method.items() if k != "name"})
    except (DatasetError, MethodError) as error:
        return trial.key("unavailable", str(error)), error
    return trial.key(data, version(method)), None


def done(trial: Trial, settings: Settings) -> tuple[str, Outcome | None]:
    """The trial's key and its record, if it is done."""
    key, _ = identify(trial, settings)
    return key, storage.read_record(settings.trials / key)


def execute(trial: Trial, settings: Settings) -> tuple[Outcome, bool]:
    """Run a trial unless it is done, and return its record and whether it ran.

    Two processes that meet at one trial wait for each other, and the second finds it done.
    """
    key, reason = identify(trial, settings)
    folder = settings.trials / key
    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / ".lock"):
        before = storage.read_record(folder)
        if before is not None and not _again(before, settings.rerun):
            note(settings, Entry(key, trial.title, before.status, ran=False))
            return before, False
        (folder / storage.TRACEBACK).unlink(missing_ok=True)
        start = time.monotonic()
        blank = _blank(trial, key, settings.sweep)
        if reason:
            status = ABSENT if isinstance(reason, MissingData) else FAILED
            storage.write_record(folder, replace(blank, status=status, error=str(reason)))
        else:
            stand_in = settings.missing == "stand_in"
            running = place(settings.output, settings.sweep, key)
            ended = run_isolated(
                "harness.worker:work",
                (trial, blank, settings.data, stand_in, folder, settings.memory_gb, running),
                seconds=settings.seconds,
                memory_gb=settings.memory_gb,
                threads=settings.threads,
                log=folder / storage.LOG,
            )
            if running is not None:
                running.unlink(missing_ok=True)
            if ended.status != OK:
                seconds = round(time.monotonic() - start, 4)
                storage.write_record(folder, replace(blank, status=ended.status, error=ended.detail, seconds=seconds))
        outcome = storage.read_record(folder)
        assert outcome is not None
        if outcome.status != OK:
            (folder / storage.ARRAYS).unlink(missing_ok=True)  # of an earlier run
        note(settings, Entry(key, trial.title, outcome.status, ran=True))
        return outcome, True


def note(settings: Settings, entry: Entry) -> None:
    """Append a line to the sweep's journal; one write, so that workers' lines never mix."""
    if settings.sweep:
        path = journal(settings.output, settings.sweep)
        path.parent.mkdir(parents=True, exist_ok=True)
        line = json.dumps(entry.__dict__) + "\n"
        handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            os.write(handle, line.encode())
        finally:
            os.close(handle)


def journal(output: Path, sweep: str) -> Path:
    return output / "sweeps" / sweep / "trials.jsonl"


def entries(path: Path, start: int = 0) -> Iterator[tuple[Entry, int]]:
    """Whole lines of a journal from a byte offset on, each with the offset behind it."""
    if not path.is_file():
        return
    with path.open("rb") as stream:
        stream.seek(start)
        for line in stream:
            if not line.endswith(b"\n"):
                return
            start += len(line)
            yield Entry(**json.loads(line)), start


def _again(before: Outcome, rerun: str) -> bool:
    return rerun == "all" or (rerun == "failed" and before.status != OK)


def _blank(trial: Trial, key: str, sweep: str) -> Outcome:
    """What is known of an outcome before the trial runs."""
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
        sweep=sweep,
        parameters={
            "dataset": dict(trial.dataset),
            "method": dict(trial.method),
            "cameras": dict(trial.cameras),
            "noise": dict(trial.noise),
            "gaps": dict(trial.gaps),
        },
    )
