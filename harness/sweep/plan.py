"""What a run would do: every trial's state, what it is going to take, and what may come in the way."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.registry import load_scene
from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import Request
from nrsfm.harness.evaluate.memory import Size, foreseen_gb, refusal
from nrsfm.harness.record.environment import cores
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.trial import Trial, digest
from nrsfm.harness.sweep.forecast import OVERHEAD, Forecast, History, free_mb, memory_mb, side_by_side, size_words
from nrsfm.harness.sweep.launcher import Launcher
from nrsfm.harness.trial.execute import identify, repeats
from nrsfm.methods.base import MethodError
from nrsfm.methods.registry import build_method

UNKNOWN = "no past trial of this method"


@dataclass(frozen=True)
class Planned:
    """A trial of an experiment and what is known of it.

    Parameters
    ----------
    trial : Trial
    key : str
    outcome : Outcome or None
        Its record.
    runs : bool
        Whether a run would carry it out.
    reason : str
        Why it cannot, "" when it can or need not.
    forecast : Forecast or None
        What it is going to take; None where that is not known.
    foreseen_mb : float or None
        The memory that its method says it is going to take.
    """

    trial: Trial
    key: str
    outcome: Outcome | None
    runs: bool
    reason: str = ""
    forecast: Forecast | None = None
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
        """What its method foresees, else what past trials took."""
        return self.foreseen_mb or (self.forecast.peak_mb if self.forecast else None)

    @property
    def words(self) -> str:
        """Where its numbers are from, or what is in the way."""
        if self.reason or (self.outcome is not None and not self.runs):
            return self.reason or (self.outcome.error if self.outcome else "")
        return f"from {self.forecast.basis}" if self.forecast else UNKNOWN


@dataclass(frozen=True)
class Plan:
    """The trials of a run, and the workers that would carry them out."""

    trials: Sequence[Planned]
    settings: Settings
    workers: int
    here: bool
    """Whether the workers are processes of this machine."""
    free_mb: float

    @cached_property
    def to_run(self) -> list[Planned]:
        return [item for item in self.trials if item.runs]

    @cached_property
    def known(self) -> list[Forecast]:
        """What is expected of those that can run, as far as it is known."""
        return [item.forecast for item in self.to_run if item.forecast and not item.reason]

    @property
    def unknown(self) -> int:
        return sum(not (item.forecast or item.reason) for item in self.to_run)

    @property
    def counts(self) -> Counter[str]:
        return Counter(item.state for item in self.trials)

    @property
    def cpu_seconds(self) -> float:
        return sum(f.cpu_seconds for f in self.known)

    @property
    def wall_seconds(self) -> float:
        """By the workers side by side, but never less than this machine's cores need."""
        wall = side_by_side((f.seconds + OVERHEAD for f in self.known), self.workers)
        return max(wall, self.cpu_seconds / cores()) if self.here else wall

    @property
    def disk_mb(self) -> float:
        return sum(f.disk_mb for f in self.known)

    @property
    def memory_mb(self) -> float:
        """Of the largest trial."""
        return max((item.memory_mb or 0.0 for item in self.to_run if not item.reason), default=0.0)

    @property
    def fits(self) -> bool:
        """Whether the disk is large enough."""
        return self.disk_mb < self.free_mb

    @property
    def warnings(self) -> Iterator[str]:
        """What may come in the way of the run, a line each with the remedy."""
        settings = self.settings
        if not self.fits:
            yield (
                f"{settings.output}: {size_words(self.free_mb)} are free and about {size_words(self.disk_mb)} are "
                "needed; make room, or set NRSFM_OUTPUT to a larger disk"
            )
        largest = sorted((item.memory_mb or 0.0 for item in self.to_run if not item.reason), reverse=True)
        together, there = sum(largest[: self.workers]), memory_mb()
        if self.here and there is not None and together > there:
            yield (
                f"{self.workers} trials side by side may take {size_words(together)} and this machine has "
                f"{size_words(there)}; lower workers"
            )
        if long := sum(f.seconds > settings.seconds for f in self.known):
            yield f"{long} trials are expected to take longer than limits.seconds = {settings.seconds:g}; raise it"
        if self.wall_seconds > settings.sweep_seconds:
            yield (
                f"limits.sweep_seconds = {settings.sweep_seconds:g} ends the run before; the same command goes on later"
            )
        left = sum(i.outcome is not None and i.outcome.status != OK and not i.runs for i in self.trials)
        if left:
            yield f"{left} that failed are not repeated; rerun=failed runs them again"


def plan(overrides: Sequence[str]) -> Plan:
    """Every trial of the overrides with what is known of it.

    Raises
    ------
    UsageError
        If the overrides cannot be composed, or their launcher cannot be used.
    """
    request = Request.of(overrides)
    trials, settings = request.trials, request.settings
    launcher = Launcher(request, settings)
    history = History(settings, {str(trial.method["name"]) for trial, _ in trials})
    sizes: dict[str, Size | str] = {}
    planned: dict[str, Planned] = {}
    for trial, own in trials:
        key, reason = identify(trial, own)
        if key not in planned:
            outcome = read_record(own.trials / key)
            runs = outcome is None or repeats(outcome, trial, own.rerun)
            planned[key] = Planned(trial, key, outcome, runs, str(reason or "") if runs else "")
            if runs and not reason:
                planned[key] = _foreseen(planned[key], own, sizes, history)
    to_run = sum(item.runs for item in planned.values())
    workers = launcher.workers(max(to_run, 1))
    return Plan(list(planned.values()), settings, workers, launcher.local, free_mb(settings.output))


def _foreseen(item: Planned, settings: Settings, sizes: dict[str, Size | str], history: History) -> Planned:
    """With what the trial is going to take, or why it cannot run; each scene is made once for that."""
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
    forecast = history.forecast(trial, (size.n_frames, size.n_points))
    return replace(item, reason=why, forecast=forecast, foreseen_mb=None if need is None else 1024 * need)
