"""Start the workers of a sweep: threads of this process, or jobs of a Hydra launcher."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from nrsfm.harness.config.address import SECRETS
from nrsfm.harness.config.spans import Request
from nrsfm.harness.record.environment import cores
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.sweep.application import call_hydra
from nrsfm.harness.sweep.work import Work, go_through

BASIC, SLURM, RAY = "basic", "submitit_slurm", "ray"
RAY_STORE = 75 << 20  # bytes; small, because no result passes through Ray's store


class Launcher:
    """Starts the workers of a sweep.

    With ``basic``, Hydra's default, they are threads of this process, since every trial is a process anyway. With any
    other launcher every worker is one Hydra job: ``joblib``, ``submitit_local`` and ``ray`` start processes,
    ``submitit_slurm`` the tasks of a job array.

    Parameters
    ----------
    request : Request
        Its settings ``workers``, ``threads`` and ``output``, and Hydra's launcher.

    Raises
    ------
    UsageError
        If the launcher is not installed, or the number of workers is missing.
    """

    def __init__(self, request: Request) -> None:
        settings = self._settings = request.settings
        self._overrides, hydra = request.launching, request.hydra
        if hydra.callbacks:
            raise UsageError("hydra.callbacks would run any code that a configuration names; remove them")
        self._name: str = hydra.runtime.choices["hydra/launcher"]
        if self._name == SLURM and settings.workers is None:
            raise UsageError("set how many Slurm jobs share the trials, as in workers=20")
        n_jobs = max(hydra.launcher.get("n_jobs", 0), 0)  # joblib's own setting
        self._config: DictConfig = hydra.launcher
        self._most: int = settings.workers or n_jobs or cores() // settings.threads or 1

    @property
    def local(self) -> bool:
        """Whether the workers run on this machine."""
        return self._name in (BASIC, "joblib", "submitit_local")

    def workers(self, n_jobs: int) -> int:
        """Number of workers for a number of jobs."""
        return min(n_jobs, self._most)

    def launch(self, work: Work) -> None:
        """Have workers go through the work; returns when they have ended, raises what one of them raised."""
        n_workers = self.workers(len(work.jobs))
        if self._name == BASIC:
            _threads(work, n_workers)
            return
        n_jobs = [f"hydra.launcher.n_jobs={n_workers}"] if self._name == "joblib" else []
        place = [f"sweep={work.jobs[0].settings.sweep}", f"output={_quoted(self._settings.output)}"]
        task = [f"+work={_quoted(work.path)}", f"+worker=range({n_workers})"]
        with _blocked(signal.SIGINT) if self._name == "submitit_local" else nullcontext(), _without_login():
            if self._name == RAY:
                _start_ray(OmegaConf.to_container(self._config.ray.init, resolve=True))
            call_hydra(["--multirun", *self._overrides, *n_jobs, "hydra.sweeper.params=null", *place, *task])


def _threads(work: Work, n_workers: int) -> None:
    """Run workers as threads; an interrupt stops them all, an error of one is raised when all have ended."""
    with ThreadPoolExecutor(n_workers) as pool:
        workers = [pool.submit(go_through, work) for _ in range(n_workers)]
        try:
            wait(workers)
        except BaseException:
            work.end()
            raise
    for worker in workers:
        worker.result()


def _start_ray(config: Any) -> None:
    """Start Ray or join its cluster before the launcher does, and restore SIGTERM's handler, which Ray replaces."""
    import ray

    if not ray.is_initialized():
        handler = signal.getsignal(signal.SIGTERM)
        try:
            # an existing cluster has its store, and Ray refuses a size for it
            ray.init(**({} if config.get("address") else {"object_store_memory": RAY_STORE}) | config)
        finally:
            signal.signal(signal.SIGTERM, handler)


@contextmanager
def _blocked(sign: signal.Signals) -> Iterator[None]:
    """Keep a signal from processes started meanwhile; another thread of this process still receives it."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {sign})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {sign})


@contextmanager
def _without_login() -> Iterator[None]:
    """Hide the tracker's login from the workers' environment: schedulers store it, and workers do not need it."""
    kept = {name: os.environ.pop(name) for name in SECRETS if name in os.environ}
    try:
        yield
    finally:
        os.environ.update(kept)


def _quoted(path: Path) -> str:
    """A path quoted for Hydra's override grammar."""
    text = str(path).replace("\\", "\\\\").replace("'", "\\'")
    return f"'{text}'"
