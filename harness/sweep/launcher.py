"""Workers for a sweep: threads of this process, or jobs of the Hydra launcher that was asked for."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from nrsfm.harness.config.address import SECRETS
from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import Request
from nrsfm.harness.record.environment import cores
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.sweep.work import Work, go_through

BASIC, SLURM, RAY = "basic", "submitit_slurm", "ray"


RAY_STORE = 75 << 20  # bytes: no result passes through it, trials write their own


class Launcher:
    """Starts the workers of a sweep.

    With ``basic``, Hydra's default, they are threads of this process: the trials are processes of their own anyway.
    With any other launcher every worker is one Hydra job: ``joblib``, ``submitit_local`` and ``ray`` start processes,
    ``submitit_slurm`` the jobs of an array.

    Parameters
    ----------
    request : Request
    settings : Settings
        ``workers``, ``threads``, and the output folder.

    Raises
    ------
    UsageError
        If the launcher is not installed, or the number of workers is missing.
    """

    def __init__(self, request: Request, settings: Settings) -> None:
        self._settings = settings
        self._own, hydra = request.launching, request.hydra
        if hydra.callbacks:
            raise UsageError("hydra.callbacks would run whatever a configuration names; take them out")
        self._name: str = hydra.runtime.choices["hydra/launcher"]
        if self._name == SLURM and settings.workers is None:
            raise UsageError("say how many Slurm jobs are to share the trials: workers=20")
        n_jobs = max(hydra.launcher.get("n_jobs", 0), 0)  # joblib's own word
        self._config: DictConfig = hydra.launcher
        self._most: int = settings.workers or n_jobs or cores() // settings.threads or 1

    @property
    def local(self) -> bool:
        """Whether the workers are of this machine."""
        return self._name in (BASIC, "joblib", "submitit_local")

    def workers(self, n_jobs: int) -> int:
        """How many workers share so many jobs."""
        return min(n_jobs, self._most)

    def launch(self, work: Work, hydra: Callable[[list[str]], object]) -> None:
        """Have workers go through the work, with ``hydra`` given the command line that starts them elsewhere."""
        n_workers = self.workers(len(work.jobs))
        if self._name == BASIC:
            _threads(work, n_workers)
            return
        own = [f"hydra.launcher.n_jobs={n_workers}"] if self._name == "joblib" else []
        place = [f"sweep={self._settings.sweep}", f"output={_quoted(self._settings.output)}"]
        task = [f"+work={_quoted(work.path)}", f"+worker=range({n_workers})"]
        with _to_itself(signal.SIGINT) if self._name == "submitit_local" else nullcontext(), _untold():
            if self._name == RAY:
                _start_ray(OmegaConf.to_container(self._config.ray.init, resolve=True))
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


def _start_ray(config: Any) -> None:
    """Start Ray, or join its cluster, before its launcher does, and take SIGTERM back from it: Ray would abort."""
    import ray

    if not ray.is_initialized():
        handler = signal.getsignal(signal.SIGTERM)
        try:
            # a cluster that is there has its store, and Ray refuses to be told the size
            ray.init(**({} if config.get("address") else {"object_store_memory": RAY_STORE}) | config)
        finally:
            signal.signal(signal.SIGTERM, handler)


@contextmanager
def _to_itself(sign: signal.Signals) -> Iterator[None]:
    """Keep a signal from processes that are started meanwhile; another thread of this one still takes it."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {sign})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {sign})


@contextmanager
def _untold() -> Iterator[None]:
    """Keep the tracker's login from the environment of workers, which a scheduler writes down: they never need it."""
    kept = {name: os.environ.pop(name) for name in SECRETS if name in os.environ}
    try:
        yield
    finally:
        os.environ.update(kept)


def _quoted(path: Path) -> str:
    """A path as Hydra's override grammar takes it, whatever its characters."""
    text = str(path).replace("\\", "\\\\").replace("'", "\\'")
    return f"'{text}'"
