"""The verb ``solve``: somebody's tracks in, structure and labels out. No tracker, no trial folder."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from harness import parsers
from harness.record import AUTO, UsageError

ALLOWED = ("method.", "+method.", "cameras.", "+cameras.", "limits.memory_gb=", "threads=")


def main(argv: Sequence[str]) -> int:
    """Run the verb; returns its exit code.

    Raises
    ------
    DatasetError
        If the file cannot be used.
    UsageError
        If the command line cannot be used, or the folder is somebody else's.
    """
    given = parsers.solve().read(argv)
    if odd := [word for word in given.overrides if not word.startswith(ALLOWED)]:
        raise UsageError(f"{odd[0]!r} is no override of method., cameras., limits.memory_gb or threads; see --help")
    try:
        return _solve(given)
    except KeyboardInterrupt:
        print("harness solve: interrupted; nothing was written", file=sys.stderr)
        return 130


def _solve(given: Any) -> int:
    from harness.configurations import compose_config
    from harness.experiments import read
    from harness.export import VIEW, check_folder, save
    from harness.solution import load, solve
    from methods.base import MethodError

    n_bodies = _number(given.bodies)
    settings = read(compose_config([f"method={given.method}"]))[1]
    scene = load(given.file)
    folder = (given.out or settings.output / "solve" / scene.name).expanduser()
    check_folder(folder)
    asked = {"method": given.method, "cameras": given.cameras, "rank": given.rank, "overrides": given.overrides}
    again = f"harness run dataset=tracks dataset.file={given.file} method={given.method}"
    try:
        with _progress(f"{scene.n_points} tracks over {scene.n_frames} frames") as progress:
            solution = solve(scene, n_bodies, **asked, progress=progress)
    except (MethodError, MemoryError) as error:
        said = str(error) or "there is not enough memory; take fewer tracks, or a method for dense tracks (ours_c)"
        print(f"harness solve: {' '.join(said.split())}", file=sys.stderr)
        return 2
    except (UsageError, OSError):
        raise
    except Exception as error:  # whatever a method makes of the tracks
        said = " ".join(f"{type(error).__name__}: {error}".split())[:500]
        print(f"harness solve: {given.method} ended with {said}; '{again}' keeps the traceback", file=sys.stderr)
        return 2
    print(solution)
    save(solution, folder)
    print(f"{'written to':<13} {folder}")
    print(f"{'look at it':<13} {(folder / VIEW).resolve().as_uri()}")
    if given.open:
        import webbrowser

        webbrowser.open((folder / VIEW).resolve().as_uri())
    return 0


def _number(word: str | None) -> int | str | None:
    if word is None or word == AUTO:
        return word
    try:
        return int(word)
    except ValueError:
        raise UsageError(f"--bodies is {word!r}, wanted a whole number or auto") from None


class _Bar:
    """A :data:`methods.base.Progress` that a terminal shows."""

    def __init__(self, bars: Any, scene: str) -> None:
        self._bars, self._scene, self._said = bars, scene, ""
        self._task = bars.add_task(scene, total=None)

    def stage(self, name: str) -> None:
        self._said = f"{self._scene}: {name}"
        self._bars.update(self._task, description=self._said, completed=0, total=None)

    def __call__(self, iteration: int, iterations: int, residuals: Mapping[str, float]) -> None:
        words = ", ".join(f"{name} {value:.0e}" for name, value in residuals.items())
        self._bars.update(self._task, completed=iteration, total=iterations, description=f"{self._said}, {words}")


@contextmanager
def _progress(scene: str) -> Iterator[_Bar | None]:
    """What tells a terminal what is at work and how far it is; elsewhere nothing is said."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True) as bars:
        yield _Bar(bars, scene)
