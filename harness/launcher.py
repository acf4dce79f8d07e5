"""Workers for a sweep: threads of this process, or jobs of the Hydra launcher that was asked for."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager, nullcontext
from pathlib import Path

from hydra import compose

from harness.experiments import Settings, configurations, launching
from harness.record import UsageError
from harness.sweep import Work, go_through

BASIC, SLURM = "basic", "submitit_slurm"


class Launcher:
    """Starts the workers of a sweep.

    With ``basic``, Hydra's default, they are threads of this process: the trials are processes of their own anyway.
    With any other launcher every worker is one Hydra job: ``joblib``, ``submitit_local`` and ``ray`` start processes,
    ``submitit_slurm`` the jobs of an array.

    Parameters
    ----------
    overrides : sequence of str
    settings : Settings
        ``workers``, ``threads``, and the output folder.

    Raises
    ------
    UsageError
        If the launcher is not installed, or the number of workers is missing.
    """

    def __init__(self, overrides: Sequence[str], settings: Settings) -> None:
        self._settings = settings
        self._own = launching(overrides)
        with configurations():
            hydra = compose("config", overrides=self._own, return_hydra_config=True).hydra
        if hydra.callbacks:
            raise UsageError("hydra.callbacks would run whatever a configuration names; take them out")
        self._name: str = hydra.runtime.choices["hydra/launcher"]
        if self._name == SLURM and settings.workers is None:
            raise UsageError("say how many Slurm jobs are to share the trials: workers=20")
        n_jobs = max(hydra.launcher.get("n_jobs", 0), 0)  # joblib's own word
        self._most: int = settings.workers or n_jobs or _cores() // settings.threads or 1

    def launch(self, work: Work, hydra: Callable[[list[str]], object]) -> None:
        """Have workers go through the work, with ``hydra`` given the command line that starts them elsewhere."""
        n_workers = min(len(work.jobs), self._most)
        if self._name == BASIC:
            _threads(work, n_workers)
            return
        own = [f"hydra.launcher.n_jobs={n_workers}"] if self._name == "joblib" else []
        place = [f"sweep={self._settings.sweep}", f"output={_quoted(self._settings.output)}"]
        task = [f"+work={_quoted(work.path)}", f"+worker=range({n_workers})"]
        with _to_itself(signal.SIGINT) if self._name == "submitit_local" else nullcontext():
            hydra(["--multirun", *self._own, *own, "hydra.sweeper.params=null", *place, *task])


def _threads(work: Work, n_workers: int) -> None:
    """Workers as threads; an interrupt of this one ends them all, an error of one is raised when all are through."""
    with ThreadPoolExecutor(n_workers) as pool:
        workers = [pool.submit(go_through, work) for _ in range(n_workers)]
        try:
            wait(workers)
        except BaseException:
            work.end()
            raise
    for worker in workers:
        worker.result()


@contextmanager
def _to_itself(sign: signal.Signals) -> Iterator[None]:
    """Keep a signal from processes that are started meanwhile; another thread of this one still takes it."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {sign})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {sign})


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _quoted(path: Path) -> str:
    """A path as Hydra's override grammar takes it, whatever its characters."""
    text = str(path).replace("\\", "\\\\").replace("'", "\\'")
    return f"'{text}'"
