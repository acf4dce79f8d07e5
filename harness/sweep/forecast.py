"""Expected time, memory and disk of trials: the median of past trials of the same method and size."""

from __future__ import annotations

import heapq
import math
import os
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import NamedTuple

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.environment import environment
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.trial import Trial

OVERHEAD = 0.05  # seconds that a worker spends around each trial, measured on trials that return at once


@dataclass(frozen=True)
class Forecast:
    """Expected wall and CPU seconds, MB of memory and of disk, and the past trials that they are taken from."""

    seconds: float
    cpu_seconds: float
    peak_mb: float
    disk_mb: float
    basis: str


class Past(NamedTuple):
    """A finished trial, its frames and tracks, and the MB of disk that its files take."""

    outcome: Outcome
    size: tuple[int, int]
    disk_mb: float


class History:
    """The finished trials of some methods in an output folder.

    Where the tracker is a SQLite file, their disk includes the copies that are artifacts, and a share of that file.
    """

    def __init__(self, settings: Settings, methods: Collection[str]) -> None:
        folders = sorted(settings.trials.glob("*/"))
        local = settings.tracking_uri.startswith("sqlite:///")
        store = Path(settings.tracking_uri.removeprefix("sqlite:///"))
        share = store.stat().st_size / len(folders) / 2**20 if local and folders and store.is_file() else 0.0
        self._past: dict[str, list[Past]] = {}
        for folder in folders:
            outcome = read_record(folder)
            if outcome is not None and outcome.status == OK and outcome.method in methods and outcome.n_points:
                size, disk = (outcome.n_frames or 0, outcome.n_points), share + (2 if local else 1) * _disk_mb(folder)
                self._past.setdefault(outcome.method, []).append(Past(outcome, size, disk))

    def forecast(self, trial: Trial, size: tuple[int, int]) -> Forecast | None:
        """Median of the past trials of this method and size, frames and tracks; None where there is none.

        Trials with the same source of cameras are preferred. Memory and disk are those of the largest trial.
        """
        past = [past for past in self._comparable(trial) if past.size == size]
        if not past:
            return None
        processor = environment()["processor"]
        elsewhere = sum(p.outcome.environment.get("processor") != processor for p in past)
        place = f", {'' if elsewhere == len(past) else 'some '}on another processor" if elsewhere else ""
        return Forecast(
            seconds=median(p.outcome.seconds or 0.0 for p in past),
            cpu_seconds=median(p.outcome.cpu_seconds or p.outcome.seconds or 0.0 for p in past),
            peak_mb=max(p.outcome.peak_mb or 0.0 for p in past),
            disk_mb=max(p.disk_mb for p in past),
            basis=f"{len(past)} trial{'' if len(past) == 1 else 's'} of this size{place}",
        )

    def unknown(self, trial: Trial, size: tuple[int, int]) -> str:
        """Why there is no forecast, with the seconds of the nearest size, unscaled, where there is one."""
        past = self._comparable(trial)
        if not past:
            return "no past trial of this method"
        ratios = {p.size: math.prod(p.size) / math.prod(size) for p in past}
        frames, tracks = min(ratios, key=lambda other: abs(math.log(ratios[other])))
        seconds = median(p.outcome.seconds or 0.0 for p in past if p.size == (frames, tracks))
        return f"no past trial of this size; {tracks} tracks, {frames} frames took {time_words(seconds)}"

    def _comparable(self, trial: Trial) -> list[Past]:
        """Past trials of the method, with the same source of cameras where there are such."""
        past = self._past.get(str(trial.method["name"]), [])
        cameras = str(trial.cameras["source"])
        return [p for p in past if p.outcome.cameras == cameras] or past


def side_by_side(seconds: Iterable[float], workers: int) -> float:
    """Wall seconds of trials run in this order by workers that each take the next one."""
    free = [0.0] * workers
    for length in seconds:
        heapq.heapreplace(free, free[0] + length)
    return max(free)


def _disk_mb(folder: Path) -> float:
    """MB of disk that a trial's files take, in whole blocks."""
    with os.scandir(folder) as files:
        return sum((file.stat().st_blocks * 512 for file in files if file.is_file(follow_symlinks=False)), 0) / 2**20


def time_words(seconds: float) -> str:
    """``0.42 s``, ``12 s``, ``3.5 min``, ``2.1 h``."""
    if seconds < 10:
        return f"{seconds:.2g} s"
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def size_words(mb: float) -> str:
    """``0.3 MB``, ``354 MB``, ``2.1 GB``; 1 GB is 1024 MB of 2^20 bytes."""
    if mb >= 1024:
        return f"{mb / 1024:.1f} GB"
    return f"{mb:.0f} MB" if mb >= 10 else f"{mb:.2g} MB"
