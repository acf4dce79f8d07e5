"""What trials are going to take, judged by what earlier ones took."""

from __future__ import annotations

import heapq
import math
import os
import shutil
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, median

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.environment import environment
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.trial import Trial

FRAMES_POINTS = tuple[int, int]


OVERHEAD = 0.05  # seconds of a worker around each trial, measured on trials that return at once


FITTED = 3  # sizes that an exponent is taken from


STEEPEST = 3.0  # exponent that is believed


@dataclass(frozen=True)
class Forecast:
    """What one trial is expected to take: wall and CPU seconds, MB of memory and of disk, and from which trials."""

    seconds: float
    cpu_seconds: float
    peak_mb: float
    disk_mb: float
    basis: str


@dataclass(frozen=True)
class Past:
    """A finished trial, and what its files take of the disk."""

    outcome: Outcome
    disk_mb: float

    @property
    def size(self) -> FRAMES_POINTS:
        return self.outcome.n_frames or 0, self.outcome.n_points or 0

    @property
    def seconds(self) -> float:
        return self.outcome.seconds or 0.0

    @property
    def cpu_seconds(self) -> float:
        """Of a record that does not tell: as if one core had worked all the time."""
        return self.seconds if self.outcome.cpu_seconds is None else self.outcome.cpu_seconds

    @property
    def peak_mb(self) -> float:
        return self.outcome.peak_mb or 0.0


class History:
    """The finished trials of an output folder.

    What they take of the disk holds, where the tracker is a SQLite file, the copies of their files that are artifacts
    beside it, and their share of that file.

    Parameters
    ----------
    settings : Settings
    methods : collection of str
        Names of those that are of interest.
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
                taken = share + (2 if local else 1) * _taken_mb(folder)
                self._past.setdefault(outcome.method, []).append(Past(outcome, taken))

    def forecast(self, trial: Trial, size: FRAMES_POINTS) -> Forecast | None:
        """What a trial of (frames, points) is going to take; None if none of its method was before.

        Trials of the same size, frames and points, say it by their median. Otherwise the nearest size does, scaled by
        a power of frames x points: the slope of a line through all sizes in double logarithms where there are three,
        else 1. Memory and disk go by the largest trial instead of the median.
        """
        past = self._past.get(str(trial.method["name"]), [])
        cameras = str(trial.cameras["source"])
        past = [p for p in past if p.outcome.cameras == cameras] or past
        if not past:
            return None
        return Forecast(
            seconds=_scaled(past, size, lambda p: p.seconds, median),
            cpu_seconds=_scaled(past, size, lambda p: p.cpu_seconds, median),
            peak_mb=_scaled(past, size, lambda p: p.peak_mb, max),
            disk_mb=_scaled(past, size, lambda p: p.disk_mb, max),
            basis=_basis(past, size),
        )


def _scaled(
    past: Sequence[Past], size: FRAMES_POINTS, of: Callable[[Past], float], middle: Callable[[Iterable[float]], float]
) -> float:
    groups: dict[FRAMES_POINTS, list[float]] = {}
    for p in past:
        groups.setdefault(p.size, []).append(of(p))
    known = {held: middle(values) for held, values in groups.items()}
    if size in known:
        return known[size]
    return scaled({math.prod(held): value for held, value in known.items()}, math.prod(size))


def scaled(known: Mapping[int, float], size: int) -> float:
    """The value at a size from those at others: the nearest's, times a power of the ratio of the sizes."""
    nearest = min(known, key=lambda held: abs(math.log(held / size)))
    points = [(math.log(held), math.log(value)) for held, value in known.items() if value > 0]
    slope = _slope(points) if len(points) >= FITTED else 1.0
    return known[nearest] * (size / nearest) ** slope


def _slope(points: Sequence[tuple[float, float]]) -> float:
    """Of the least-squares line, between none and the steepest that is believed."""
    x0, y0 = (fmean(values) for values in zip(*points, strict=True))
    slope = sum((x - x0) * (y - y0) for x, y in points) / sum((x - x0) ** 2 for x, _ in points)
    return min(max(slope, 0.0), STEEPEST)


def _basis(past: Sequence[Past], size: FRAMES_POINTS) -> str:
    """``12 trials, 116 to 132 tracks``: what a forecast rests on."""
    same = [p for p in past if p.size == size]
    used = same or past
    words = f"{len(used)} trial{'' if len(used) == 1 else 's'}"
    if same:
        words += " of this size"
    else:
        frames, points = ((min(v), max(v)) for v in zip(*(p.size for p in used), strict=True))
        words += f", {_span(points)} tracks, {_span(frames)} frames"
    elsewhere = sum(p.outcome.environment.get("processor") != environment()["processor"] for p in used)
    return words + (f", {'' if elsewhere == len(used) else 'some '}on another processor" if elsewhere else "")


def _span(ends: tuple[int, int]) -> str:
    low, high = ends
    return f"{low}" if low == high else f"{low} to {high}"


def side_by_side(seconds: Iterable[float], workers: int) -> float:
    """Wall seconds of trials by workers that each take the next one, in this order."""
    free = [0.0] * workers
    for length in seconds:
        heapq.heapreplace(free, free[0] + length)
    return max(free)


def free_mb(place: Path) -> float:
    """MB that are free where a folder stands or is going to stand."""
    while not place.exists():
        place = place.parent
    return shutil.disk_usage(place).free / 2**20


def memory_mb() -> float | None:
    """MB of this machine; None where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**20
    except (ValueError, OSError):
        return None


def _taken_mb(folder: Path) -> float:
    """What a trial's files take of the disk, in whole blocks."""
    with os.scandir(folder) as files:
        return sum(file.stat().st_blocks * 512 for file in files if file.is_file(follow_symlinks=False)) / 2**20


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
