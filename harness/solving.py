"""The verb ``solve``: somebody's tracks in, structure and labels out. No tracker, no trial folder."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from harness import parsers
from harness.record import AUTO, UsageError

ALLOWED = ("method.", "+method.", "cameras.", "+cameras.", "limits.memory_gb=")


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
        raise UsageError(f"{odd[0]!r} is no override of {', '.join(ALLOWED[::2])} or limits.memory_gb; see --help")
    try:
        return _solve(given)
    except KeyboardInterrupt:
        print("harness solve: interrupted; nothing was written", file=sys.stderr)
        return 130


def _solve(given: Any) -> int:
    from harness.experiments import compose_config, read
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
        with _progress() as (stage, progress):
            solution = solve(scene, n_bodies, **asked, stage=stage, progress=progress)
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


@contextmanager
def _progress() -> Iterator[Any]:
    """Two functions that tell a terminal what is at work and how far it is; elsewhere they say nothing."""
    if not sys.stderr.isatty():
        yield (lambda said: None), None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task("", total=None)
        said = ""

        def stage(words: str) -> None:
            nonlocal said
            said = words
            bars.update(task, description=words)

        def progress(iteration: int, iterations: int, residuals: Mapping[str, float]) -> None:
            words = ", ".join(f"{name} {value:.0e}" for name, value in residuals.items())
            bars.update(task, completed=iteration, total=iterations, description=f"{said}: {words}")

        yield stage, progress
