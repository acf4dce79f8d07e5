"""The verb ``run``: one trial or a sweep, as a Hydra application."""

from __future__ import annotations

import os
import secrets
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from datetime import datetime
from io import StringIO
from pathlib import Path

import hydra
from hydra._internal.utils import get_args_parser
from omegaconf import DictConfig

from harness.address import is_server, shown
from harness.experiments import Settings, expand
from harness.follow import Follower
from harness.isolation import start_server
from harness.launcher import Launcher
from harness.record import OK, Trial, UsageError
from harness.storage import check_space, read_record
from harness.sweep import Job, Work, go_through
from harness.trial import identify, journal, repeats
from harness.writer import prepare
from reports.text import printable

ATTEMPTS = 3  # in a row that may end early without a trial done


@hydra.main(config_path="pkg://conf", config_name="config", version_base="1.3")
def job(cfg: DictConfig) -> None:
    """One worker of a sweep: a Hydra job, whatever the launcher."""
    path = Path(cfg.work)
    if path.is_file():  # otherwise the sweep is over
        go_through(Work.read(path))


def main(argv: Sequence[str]) -> int:
    """Run what the overrides ask for; returns the exit code.

    Raises
    ------
    UsageError
        If the command line or the overrides cannot be used; nothing has run then.
    OSError
        If the output folder cannot be written.
    """
    asked, unknown = get_args_parser().parse_known_args(list(argv))
    if unknown:
        raise UsageError(f"{unknown[0]} is no option of 'harness run'; see 'harness run --help'")
    if asked.config_name or asked.config_path:
        raise UsageError("there is one configuration, config.yaml; --config-dir adds files to its groups")
    overrides = list(asked.overrides)
    if asked.config_dir:
        overrides.append(f"hydra.searchpath=[file://{Path(asked.config_dir).resolve()}]")
    if asked.hydra_help or asked.cfg or asked.info or asked.shell_completion:
        with redirect_stdout(StringIO()) as said:
            code = _hydra(list(argv))
        print(shown(said.getvalue()), end="")
        return code
    start_server()
    writer = prepare()
    trials = expand(overrides)
    sweep = trials[0][1].sweep or _name()
    jobs: dict[str, Job] = {}
    for trial, own in trials:
        key = identify(trial, own)[0]
        if key not in jobs:
            found = read_record(own.trials / key)
            jobs[key] = Job(trial, replace(own, sweep=sweep), found.finished if found else "")
    settings = next(iter(jobs.values())).settings
    launcher = Launcher(overrides, settings)

    def missing() -> dict[str, Job]:
        found = {key: read_record(settings.trials / key) for key in jobs}

        def again(key: str, job: Job) -> bool:
            outcome = found[key]
            return outcome is None or repeats(outcome, job.trial, job.settings.rerun, job.old)

        return {key: job for key, job in jobs.items() if again(key, job)}

    journal(settings.output, sweep).parent.mkdir(parents=True, exist_ok=True)
    asked_for = {key: job.trial for key, job in jobs.items()}
    with _interruptible(), Follower(settings, asked_for, jobs.keys() - missing().keys(), writer) as follower:
        trouble = _carry_out(missing, settings, launcher)
    if trouble:
        print(f"harness run: {printable(trouble)}; start it again to run the rest", file=sys.stderr)
    if len(jobs) > 1 or asked.multirun:
        _show(overrides, trials)
    return _report(follower)


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


def _show(overrides: Sequence[str], trials: Sequence[tuple[Trial, Settings]]) -> None:
    """Print the tables that a sweep of these trials has just filled."""
    from harness.answers import recorded
    from reports.layouts import FILLS
    from reports.span import span
    from reports.tables import build
    from reports.writers import console

    named = [word for word in overrides if word.lstrip("+").startswith("experiment=")]
    name = named[-1].partition("=")[2] if named else "sweep"
    others = [word for word in overrides if word not in named]
    for table in FILLS.get(name, (name,)):
        asked = trials if table == name else expand([f"+experiment={table}", *others])
        found = recorded(asked)
        console(build(table, found, None if named else span([trial for trial, _ in trials])))


def _attempt(work: Work, launcher: Launcher) -> str:
    """Have workers go through the work; what ended them early, or ""."""
    try:
        launcher.launch(work, _hydra)
    except Exception as error:
        return f"the sweep ended early ({type(error).__name__}: {' '.join(str(error).split())[:200]})"
    return ""


def _report(follower: Follower) -> int:
    entries = follower.entries.values()
    ran = [entry for entry in entries if entry.ran]
    before = len(entries) - len(ran)
    missing = len(follower.trials) - len(entries)
    bad = {status: n for status, n in follower.counts.items() if status != OK}
    parts = [f"{len(ran)} run" if ran else "nothing to run"]
    if before:
        parts.append(f"{before} done before")
    parts += [f"{n} {status}" for status, n in sorted(bad.items())]
    if missing:
        parts.append(f"{missing} not reached")
    total = len(follower.trials)
    print(f"{total} trial{'' if total == 1 else 's'}: {', '.join(parts)}. Output: {follower.settings.output}")
    if any(not entry.ran and entry.status != OK for entry in entries):
        print("Trials that failed before are not repeated; rerun=failed runs them again.")
    if follower.trouble:
        uri = shown(follower.settings.tracking_uri)
        place = f" tracking=server tracking.uri={uri}" if is_server(uri) else ""
        remedy = "" if "'harness sync" in follower.trouble else f", 'harness sync{place}' brings them in"
        print(f"{printable(follower.trouble)}; the trials are safe{remedy}", file=sys.stderr)
    return 2 if bad or missing or follower.trouble else 0


def _hydra(argv: list[str]) -> int:
    """Hydra's own command line; its exit code. Its errors are raised, not printed."""
    before = sys.argv
    sys.argv = ["harness run", *argv]
    os.environ["HYDRA_FULL_ERROR"] = "1"
    try:
        job()
    except SystemExit as stop:
        return int(stop.code or 0)
    finally:
        sys.argv = before
    return 0


def _name() -> str:
    return f"{datetime.now():%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"
