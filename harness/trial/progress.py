"""The progress of a running trial: written to a file by its process, read by the follower of the sweep."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Lt

from nrsfm.harness.record.untrusted import checked, read_bounded

LARGEST = 1 << 16  # bytes of the file
SECONDS, LOG_SECONDS = 0.5, 10.0  # between two iterations that are written to the file, and to the trial's log


@dataclass(frozen=True)
class Step:
    """Stage of a trial, and in it the iteration, the largest number of iterations, and residuals by name."""

    title: str
    stage: str = ""
    iteration: Annotated[int, Ge(0), Lt(10**9)] = 0
    iterations: Annotated[int, Ge(0), Lt(10**9)] = 0
    residuals: Mapping[str, float] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """The step as ``structure 120/6000: primal 1e-03, dual 4e-02``."""
        where = f"{self.stage} {self.iteration}/{self.iterations}".strip() if self.iterations else self.stage
        residuals = ", ".join(f"{name} {value:.0e}" for name, value in self.residuals.items())
        return f"{where}: {residuals}" if residuals else where


class Reporter:
    """A :data:`nrsfm.methods.base.Progress` that writes to a file, and to standard output, the trial's log."""

    def __init__(self, title: str, path: Path | None) -> None:
        self.title, self.path = title, path
        self._stage = ""
        self._written, self._logged = 0.0, time.monotonic()
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)

    def stage(self, name: str) -> None:
        """See :func:`nrsfm.methods.base.stage`; written at once, because a stage may be long and have no iterations."""
        if name != self._stage:
            self._stage = name
            self._write(Step(self.title, name))

    def __call__(self, iteration: int, iterations: int, residuals: Mapping[str, float]) -> None:
        now, step = time.monotonic(), Step(self.title, self._stage, iteration, iterations, dict(residuals))
        if now - self._logged > LOG_SECONDS:
            self._logged = now
            print(step.words, flush=True)
        if now - self._written > SECONDS:
            self._written = now
            self._write(step)

    def _write(self, step: Step) -> None:
        if self.path is not None:
            fresh = self.path.with_suffix(".new")
            fresh.write_text(json.dumps(step.__dict__))
            fresh.replace(self.path)


def place(output: Path, sweep: str, key: str) -> Path | None:
    """The progress file of a trial of a sweep; None outside a sweep."""
    return output / "sweeps" / sweep / "running" / f"{key}.json" if sweep else None


def forget(path: Path | None) -> None:
    """Remove the progress file of a trial that has ended."""
    if path is not None:
        path.unlink(missing_ok=True)
        path.with_suffix(".new").unlink(missing_ok=True)


def steps(output: Path, sweep: str) -> Iterator[tuple[str, Step]]:
    """Key and step of every running trial."""
    for path in sorted((output / "sweeps" / sweep / "running").glob("*.json")):
        with suppress(ValueError):  # the trial has just ended, or the file is invalid
            yield path.stem, checked(Step, read_bounded(path, LARGEST))
