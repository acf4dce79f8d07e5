from __future__ import annotations

import os
import secrets
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import hydra
from omegaconf import DictConfig

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.folder import check_space
from nrsfm.harness.sweep.launcher import Launcher
from nrsfm.harness.sweep.work import Job, Work, go_through
from nrsfm.harness.trial.journal import journal

ATTEMPTS = 3  # in a row that may end early without a trial done


@hydra.main(config_path="pkg://nrsfm.conf", config_name="config", version_base="1.3")
def job(cfg: DictConfig) -> None:
    """One worker of a sweep: a Hydra job, whatever the launcher."""
    path = Path(cfg.work)
    if path.is_file():  # otherwise the sweep is over
        go_through(Work.read(path))


def _carry_out(missing: Callable[[], dict[str, Job]], settings: Settings, launcher: Launcher) -> str:
    """Start workers until nothing is missing; what was in the way, or "".

    An attempt may end early, as when a worker is killed; the next runs the rest.
    """
    folder = journal(settings.output, settings.sweep).parent
    until, lost, trouble = time.time() + settings.sweep_seconds, 0, ""
    left = missing()
    while left and lost < ATTEMPTS and time.time() < until:
        work = Work.begin(folder / f"{secrets.token_hex(4)}.work", list(left.values()), until)
        try:
            trouble = _attempt(work, launcher)
        except BaseException:
            work.end()
            raise
        work.clear()
        still = missing()
        left, lost = still, lost + 1 if len(still) == len(left) else 0
        try:
            check_space(folder)  # however a worker's error came here
        except OSError as error:
            trouble, lost = f"{error.filename}: {error.strerror}; make room", ATTEMPTS
    if not left:
        return ""
    return f"its {settings.sweep_seconds:g} s are over" if time.time() >= until else trouble or "its workers were lost"


@contextmanager
def _interruptible() -> Iterator[None]:
    """End on SIGTERM as on Ctrl-C: workers are told, what was finished is kept."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _attempt(work: Work, launcher: Launcher) -> str:
    """Have workers go through the work; what ended them early, or ""."""
    try:
        launcher.launch(work, _hydra)
    except Exception as error:
        return f"the sweep ended early ({type(error).__name__}: {' '.join(str(error).split())[:200]})"
    return ""


def _hydra(argv: list[str]) -> int:
    """Hydra's own command line; its exit code. Its errors are raised, not printed."""
    before = sys.argv
    sys.argv = ["nrsfm run", *argv]
    os.environ["HYDRA_FULL_ERROR"] = "1"
    try:
        job()
    except SystemExit as stop:
        return int(stop.code or 0)
    finally:
        sys.argv = before
    return 0
