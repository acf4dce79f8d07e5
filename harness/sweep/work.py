"""What the workers of a sweep share: the trials to run, when to stop, and how a worker gets through them.

A sweep is composed once, by the process that was asked for it, and written into its folder. Whatever launcher starts
the workers, each takes the next trial that nobody has, so a slow trial, a lost worker or a second sweep on the same
output folder holds up nobody.
"""

from __future__ import annotations

import json
import os
import socket
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import write_text
from nrsfm.harness.record.outcome import OOM
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.trial.execute import Busy, execute
from nrsfm.harness.trial.isolation import Stopped
from nrsfm.harness.trial.journal import Entry, note

KILLED = ("killed by SIGKILL", "the process was killed, or lost")  # from outside: the kernel when memory is short


@dataclass(frozen=True)
class Job:
    """A trial of a sweep, with the settings that it runs under.

    ``old`` is when the record that the sweep found was finished, "" where there was none: any other was made since.
    """

    trial: Trial
    settings: Settings
    old: str = ""


@dataclass(frozen=True)
class Work:
    """The jobs that the workers of one attempt at a sweep go through.

    Parameters
    ----------
    path : Path
        Its file; beside it, ``.stop`` tells the workers to end.
    jobs : sequence of Job
    until : float
        Seconds since 1970 after which no trial goes on.
    home : str
        The process that asked for it: workers of the same machine end with it.
    """

    path: Path
    jobs: Sequence[Job]
    until: float
    home: str

    @classmethod
    def begin(cls, path: Path, jobs: Sequence[Job], until: float) -> Work:
        """Write down what the workers of this process are to do."""
        work = cls(path, jobs, until, _home(os.getpid()))
        rows = [{"trial": asdict(job.trial), "settings": _plain(job.settings), "old": job.old} for job in jobs]
        head = {"until": until, "home": work.home}
        write_text(path, json.dumps(head | {"jobs": rows}))
        return work

    @classmethod
    def read(cls, path: Path) -> Work:
        """The work that :meth:`begin` wrote; raises UsageError if the file is none."""
        try:
            data = json.loads(path.read_text())
            jobs = [Job(Trial(**row["trial"]), _settings(row["settings"]), row["old"]) for row in data.pop("jobs")]
            work = cls(path, jobs, **data)
            _, pid, _ = work.home.split(" ")
            fits = isinstance(work.until, int | float) and int(pid) > 0
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise UsageError(f"{path} is no list of trials ({one_line(error)}); start the sweep again") from None
        if not fits:
            raise UsageError(f"{path} is no list of trials; start the sweep again")
        return work

    def end(self) -> None:
        """Tell every worker to stop, wherever it runs."""
        self._mark.touch()

    def clear(self) -> None:
        """Remove the files, once no worker is left."""
        self.path.unlink(missing_ok=True)
        self._mark.unlink(missing_ok=True)

    @property
    def over(self) -> bool:
        """Whether the workers are to stop."""
        return time.time() > self.until or self._mark.exists()

    @property
    def _mark(self) -> Path:
        return self.path.with_suffix(".stop")


def go_through(work: Work) -> None:
    """Run, one after the other, every job that is not done and that no other worker has.

    Trials that another worker has, and those worth another try, are seen to at the end.
    """
    _end_with(work.home)

    def stopped() -> bool:
        return work.over

    tries: dict[int, int] = {}
    turn = [(i, False) for i in range(len(work.jobs))]
    while turn:
        later = []
        for i, wait in turn:
            if work.over:
                return
            job = work.jobs[i]
            trial, settings = job.trial, job.settings
            try:
                outcome, ran = execute(trial, settings, old=job.old, again=i in tries, stopped=stopped, wait=wait)
            except Busy:
                later.append((i, True))
                continue
            except Stopped:
                return
            if not ran:
                continue
            tries[i] = tries.get(i, 0) + 1
            if tries[i] <= settings.retries and (outcome.status == OOM or any(w in outcome.error for w in KILLED)):
                later.append((i, True))
            else:
                note(settings, Entry(outcome.key, trial.title, outcome.status, ran=True))
        turn = later


def _home(pid: int) -> str:
    """Names a living process of this machine, or of this job of a cluster: host, id, and when it started."""
    host = f"{socket.gethostname()}:{os.environ.get('SLURM_JOB_ID', '')}"
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        alive, started = fields[0] != "Z", fields[19]
    except OSError:
        alive, started = not Path("/proc/self").exists() and _there(pid), ""
    return f"{host} {pid} {started}" if alive else ""


def _end_with(home: str) -> None:
    """End this process when the one that asked for the work is gone; nothing to do where that is another machine."""
    host, pid, _ = home.split(" ")
    own = _home(os.getpid())
    if home == own or host != own.split(" ")[0]:
        return

    def watch() -> None:
        while _home(int(pid)) == home:
            time.sleep(0.5)
        os._exit(1)

    if not any(thread.name == home for thread in threading.enumerate()):
        threading.Thread(target=watch, name=home, daemon=True).start()


def _there(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


def _plain(settings: Settings) -> dict[str, Any]:
    """Settings as JSON has them; the tracker, whose address may hold a password, is no concern of the workers."""
    return {k: str(v) if isinstance(v, Path) else v for k, v in asdict(settings).items() if k != "tracking_uri"}


def _settings(plain: dict[str, Any]) -> Settings:
    return Settings(**plain | {name: Path(plain[name]) for name in ("output", "data")}, tracking_uri="")
