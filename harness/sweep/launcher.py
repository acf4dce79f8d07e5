"""Start the workers of a sweep: threads of this process, or jobs of a Hydra launcher."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import hydra
from omegaconf import DictConfig, OmegaConf

from nrsfm.harness.config.address import SECRETS
from nrsfm.harness.config.compose import quoted
from nrsfm.harness.config.spans import Request
from nrsfm.harness.record.environment import cores
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.sweep.work import Work, go_through
from nrsfm.harness.trial.isolation import with_environment, without_interrupt

BASIC, SLURM, RAY = "basic", "submitit_slurm", "ray"
RAY_STORE = 75 << 20  # bytes; small, because no result passes through Ray's store


class Launcher:
    """Starts the workers of a sweep; UsageError if Hydra's configuration does not say how.

    With ``basic``, Hydra's default, they are threads of this process, since every trial is a process anyway. With any
    other launcher every worker is one Hydra job: ``joblib``, ``submitit_local`` and ``ray`` start processes,
    ``submitit_slurm`` the tasks of a job array.
    """

    def __init__(self, request: Request) -> None:
        settings, chosen = request.settings, request.hydra
        if chosen.callbacks:
            raise UsageError("hydra.callbacks would run any code that a configuration names; remove them")
        self._overrides, self._config = request.launching, chosen.launcher
        self._name: str = chosen.runtime.choices["hydra/launcher"]
        if self._name == SLURM and settings.workers is None:
            raise UsageError("set how many Slurm jobs share the trials, as in workers=20")
        n_jobs = max(self._config.get("n_jobs", 0), 0)  # joblib's own setting
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
        settings = work.jobs[0].settings
        place = [f"sweep={settings.sweep}", f"output={quoted(str(settings.output))}"]
        task = [f"+work={quoted(str(work.path))}", f"+worker=range({n_workers})"]
        # schedulers store the environment, and workers do not need the tracker's login
        no_login = with_environment(dict.fromkeys(SECRETS))
        with without_interrupt() if self._name == "submitit_local" else nullcontext(), no_login:
            if self._name == RAY:
                _start_ray(OmegaConf.to_container(self._config.ray.init, resolve=True))
            call_hydra(["--multirun", *self._overrides, *n_jobs, "hydra.sweeper.params=null", *place, *task])


def worker(cfg: DictConfig) -> None:
    """The Hydra application of ``nrsfm run``: run the trials of the work file ``cfg.work`` until none is left."""
    path = Path(cfg.work)
    if path.is_file():  # otherwise the sweep has ended
        go_through(Work.read(path))


_main = hydra.main(config_path="pkg://nrsfm.conf", config_name="config", version_base="1.3")(worker)


def call_hydra(argv: Sequence[str]) -> int:
    """Run Hydra's own command line; returns its exit code. Its errors are raised, not printed."""
    before = sys.argv
    sys.argv = ["nrsfm run", *argv]
    os.environ["HYDRA_FULL_ERROR"] = "1"
    try:
        _main()
    except SystemExit as stop:
        return int(stop.code or 0)
    finally:
        sys.argv = before
    return 0


def _threads(work: Work, n_workers: int) -> None:
    """Run workers as threads; an interrupt stops them all, an error of one is raised when all have ended."""
    with ThreadPoolExecutor(n_workers) as pool:
        workers = [pool.submit(go_through, work) for _ in range(n_workers)]
        try:
            while wait(workers, timeout=1).not_done:
                pass  # an interrupt that another thread received is seen here
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
            # without an address Ray would join any cluster of this machine, and refuse a size for its store
            own = {} if config.get("address") else {"object_store_memory": RAY_STORE} | config | {"address": "local"}
            ray.init(**config | own)
        finally:
            signal.signal(signal.SIGTERM, handler)
