"""How far a trial is: told by its process in a file, read by whoever follows the sweep."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.storage import write_atomically

LARGEST = 1 << 16  # bytes of the file
SECONDS, LOG_SECONDS = 0.5, 10.0  # between two writes of the file, and of a line in the trial's log


@dataclass(frozen=True)
class Step:
    """One trial's iteration, of how many at most, and its residuals by name."""

    title: str
    iteration: int
    iterations: int
    residuals: Mapping[str, float]

    @property
    def words(self) -> str:
        """``surfaces ours_c: shape 1e-03, code 4e-02``."""
        return f"{self.title}: " + ", ".join(f"{name} {value:.0e}" for name, value in self.residuals.items())


class Reporter:
    """A :data:`methods.base.Progress` that keeps ``path`` up to date and writes to standard output, the trial's log."""

    def __init__(self, title: str, path: Path | None) -> None:
        self.title, self.path = title, path
        self._written, self._logged = 0.0, time.monotonic()

    def __call__(self, iteration: int, iterations: int, residuals: Mapping[str, float]) -> None:
        now, step = time.monotonic(), Step(self.title, iteration, iterations, dict(residuals))
        if now - self._logged > LOG_SECONDS:
            self._logged = now
            print(f"{iteration} of {iterations}: {step.words}", flush=True)
        if self.path is not None and now - self._written > SECONDS:
            self._written = now
            text = json.dumps(step.__dict__)
            write_atomically(self.path, lambda handle: handle.write(text.encode()))


def place(output: Path, sweep: str, key: str) -> Path | None:
    """The file of a trial of a sweep; None outside any sweep."""
    return output / "sweeps" / sweep / "running" / f"{key}.json" if sweep else None


def steps(output: Path, sweep: str) -> Iterator[tuple[str, Step]]:
    """Key and step of every trial that is at work."""
    for path in sorted((output / "sweeps" / sweep / "running").glob("*.json")):
        try:
            step = Step(**json.loads(path.read_bytes()[:LARGEST]))
            _ = step.words
            whole = all(type(n) is int and 0 <= n < 10**9 for n in (step.iteration, step.iterations))
        except (OSError, ValueError, TypeError, AttributeError, RecursionError):  # it ended in this moment, or is none
            continue
        if whole:
            yield path.stem, step
