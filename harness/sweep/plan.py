"""The plan of a run: the state of every trial, expected time, memory and disk, and warnings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import psutil

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.registry import load_scene
from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import Request
from nrsfm.harness.evaluate.memory import Size, foreseen_gb, refusal
from nrsfm.harness.record.environment import cores
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.trial import Trial, digest, titles
from nrsfm.harness.sweep.forecast import OVERHEAD, Forecast, History, side_by_side, size_words
from nrsfm.harness.sweep.launcher import Launcher
from nrsfm.harness.trial.execute import repeats
from nrsfm.harness.trial.identity import identify
from nrsfm.methods.base import MethodError
from nrsfm.methods.registry import build_method


@dataclass(frozen=True)
class Planned:
    """A trial of the plan, and whether ``nrsfm run`` would run it."""

    trial: Trial
    title: str
    key: str
    outcome: Outcome | None
    runs: bool
    #: Why it cannot run, "" when it can or is done.
    reason: str = ""
    forecast: Forecast | None = None
    #: Why there is no forecast, "" when there is one.
    unknown: str = ""
    #: The memory that its method foresees.
    foreseen_mb: float | None = None

    @property
    def state(self) -> str:
        if self.reason:
            return "cannot run"
        if self.outcome is None:
            return "missing"
        state = "done" if self.outcome.status == OK else self.outcome.status
        return f"{state}, again" if self.runs else state

    @property
    def memory_mb(self) -> float | None:
        """Memory that the method foresees, else that of past trials."""
        return self.foreseen_mb or (self.forecast.peak_mb if self.forecast else None)

    @property
    def words(self) -> str:
        """Origin of the forecast, or why the trial cannot run or failed."""
        if self.reason or (self.outcome is not None and not self.runs):
            return self.reason or (self.outcome.error if self.outcome else "")
        return f"from {self.forecast.basis}" if self.forecast else self.unknown


@dataclass(frozen=True)
class Plan:
    """The trials of a run, and the number of workers that would run them."""

    trials: Sequence[Planned]
    settings: Settings
    workers: int
    here: bool
    """Whether the workers run on this machine."""
    free_mb: float

    @cached_property
    def to_run(self) -> list[Planned]:
        return [item for item in self.trials if item.runs]

    @cached_property
    def known(self) -> list[Forecast]:
        """The forecasts of the trials that can run."""
        return [item.forecast for item in self.to_run if item.forecast and not item.reason]

    @property
    def unknown(self) -> int:
        """Number of trials that can run and have no forecast."""
        return sum(not (item.forecast or item.reason) for item in self.to_run)

    @property
    def counts(self) -> Counter[str]:
        return Counter(item.state for item in self.trials)

    @property
    def cpu_seconds(self) -> float:
        return sum(f.cpu_seconds for f in self.known)

    @property
    def wall_seconds(self) -> float:
        """Wall seconds of all workers side by side, at least what the CPU time needs on this machine's cores."""
        wall = side_by_side((f.seconds + OVERHEAD for f in self.known), self.workers)
        return max(wall, self.cpu_seconds / cores()) if self.here else wall

    @property
    def disk_mb(self) -> float:
        return sum(f.disk_mb for f in self.known)

    @cached_property
    def memories(self) -> list[float]:
        """MB of memory of the trials that can run, the largest first; 0 where it is unknown."""
        return sorted((item.memory_mb or 0.0 for item in self.to_run if not item.reason), reverse=True) or [0.0]

    @property
    def fits(self) -> bool:
        """Whether the free disk is large enough."""
        return self.disk_mb < self.free_mb

    @property
    def warnings(self) -> Iterator[str]:
        """What may prevent the run from completing, one line each with the remedy."""
        settings = self.settings
        if not self.fits:
            sizes = f"{size_words(self.free_mb)} are free and about {size_words(self.disk_mb)} are needed"
            yield f"{settings.output}: {sizes}; make room, or set NRSFM_OUTPUT to a larger disk"
        together, machine = sum(self.memories[: self.workers]), machine_mb()
        if self.here and together > machine:
            sizes = f"{size_words(together)} and this machine has {size_words(machine)}"
            yield f"{self.workers} trials side by side may take {sizes}; lower workers"
        if long := sum(f.seconds > settings.seconds for f in self.known):
            yield f"{long} trials are expected to take longer than limits.seconds = {settings.seconds:g}; raise it"
        if self.wall_seconds > settings.sweep_seconds:
            limit = f"limits.sweep_seconds = {settings.sweep_seconds:g}"
            yield f"{limit} ends the run before; the same command goes on later"
        left = sum(i.outcome is not None and i.outcome.status != OK and not i.runs for i in self.trials)
        if left:
            yield f"{left} that failed are not repeated; rerun=failed runs them again"
        if stale := sum(
            i.outcome is not None and not i.runs and repeats(i.outcome, i.trial, "stale") for i in self.trials
        ):
            yield f"the code or a library changed since {stale} ran; rerun=stale runs them again"


def plan(overrides: Sequence[str]) -> Plan:
    """Plan the run of the overrides; raises UsageError if they, or their launcher, cannot be used."""
    request = Request.of(overrides)
    settings, launcher = request.settings, Launcher(request)
    history = History(settings, {str(trial.method["name"]) for trial, _ in request.trials})
    sizes: dict[str, Size | str] = {}
    planned: list[Planned] = []
    names = titles([trial for trial, _ in request.trials])
    for (trial, own_settings), title in zip(request.trials, names, strict=True):
        identity = identify(trial, own_settings)
        outcome = read_record(own_settings.trials / identity.key)
        runs = outcome is None or repeats(outcome, trial, own_settings.rerun)
        item = Planned(trial, title, identity.key, outcome, runs, identity.reason if runs else "")
        planned.append(_forecast(item, own_settings, sizes, history) if item.runs and not item.reason else item)
    n_workers = launcher.workers(max(sum(item.runs for item in planned), 1))
    return Plan(planned, settings, n_workers, launcher.local, free_mb(settings.output))


def _forecast(item: Planned, settings: Settings, sizes: dict[str, Size | str], history: History) -> Planned:
    """The trial with its forecast, or the reason why it cannot run; ``sizes`` keeps the sizes of scenes made before."""
    trial, scene = item.trial, digest(item.trial.dataset)
    if scene not in sizes:
        try:
            sizes[scene] = Size.of(load_scene(trial.dataset, settings.data, settings.missing == "stand_in"))
        except DatasetError as error:
            sizes[scene] = str(error)
    size = sizes[scene]
    if isinstance(size, str):
        return replace(item, reason=size)
    method = build_method({k: v for k, v in trial.method.items() if k != "name"})
    try:
        need, why = foreseen_gb(method, size), refusal(method, size, settings.memory_gb)
    except MethodError as error:
        return replace(item, reason=str(error))
    past = (size.n_frames, size.n_points)
    foreseen_mb = None if need is None else 1024 * need
    if forecast := history.forecast(trial, past):
        return replace(item, reason=why, forecast=forecast, foreseen_mb=foreseen_mb)
    return replace(item, reason=why, unknown=history.unknown(trial, past), foreseen_mb=foreseen_mb)


def free_mb(place: Path) -> float:
    """MB of free disk where a folder is, or will be made."""
    while not place.exists():
        place = place.parent
    return float(psutil.disk_usage(str(place)).free) / 2**20


def machine_mb() -> float:
    """MB of memory of this machine."""
    return float(psutil.virtual_memory().total) / 2**20
