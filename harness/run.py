"""The verb ``run``: one trial or a sweep, as a Hydra application."""

from __future__ import annotations

import os
import secrets
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import hydra
from hydra._internal.utils import get_args_parser
from omegaconf import DictConfig

from harness.experiments import checked, effective, read
from harness.follow import Follower
from harness.record import OK, UsageError
from harness.trial import execute, journal

PARENT = "HARNESS_SWEEP_PID"
ATTEMPTS = 3  # of a sweep whose worker process was lost


@hydra.main(config_path="pkg://conf", config_name="config", version_base="1.3")
def job(cfg: DictConfig) -> str:
    """One trial of a run or sweep; its failure is an outcome, never an exception."""
    _end_with_the_sweep()
    trial, settings = read(cfg)
    outcome, _ = execute(trial, settings)
    return outcome.status


def main(argv: Sequence[str]) -> int:
    """Run what the overrides ask for; returns the exit code.

    Raises
    ------
    UsageError
        If the command line or the overrides cannot be used; nothing has run then.
    """
    asked, unknown = get_args_parser().parse_known_args(list(argv))
    if unknown:
        raise UsageError(f"{unknown[0]} is no option of 'harness run'; see 'harness run --hydra-help'")
    if asked.config_name or asked.config_path:
        raise UsageError("there is one configuration, config.yaml; --config-dir adds files to its groups")
    overrides = list(asked.overrides)
    if asked.config_dir:
        overrides.append(f"hydra.searchpath=[file://{Path(asked.config_dir).resolve()}]")
    if asked.help or asked.hydra_help or asked.cfg or asked.info or asked.shell_completion:
        return _hydra(list(argv))
    words, jobs = effective(overrides)
    _, settings = checked(jobs)
    settings = replace(settings, sweep=settings.sweep or _name())
    journal(settings.output, settings.sweep).parent.mkdir(parents=True, exist_ok=True)
    flags = ["--multirun"] if len(jobs) > 1 or asked.multirun else []
    os.environ[PARENT] = str(os.getpid())
    with Follower(settings, len(jobs)) as follower:
        for _ in range(ATTEMPTS):  # what is done is skipped, so another attempt runs the rest
            trouble = _attempt([*flags, *words, f"sweep={settings.sweep}"])
            if not trouble:
                break
    if trouble:
        print(f"harness run: {trouble}; start it again to run the rest", file=sys.stderr)
    if flags and not follower.trouble:
        _show(overrides)
    return _report(follower)


def _show(overrides: Sequence[str]) -> None:
    """Print the tables that a sweep has just filled."""
    from harness.answers import answers
    from reports.layouts import FILLS, Layout
    from reports.tables import build
    from reports.writers import console

    named = [word for word in overrides if word.lstrip("+").startswith("experiment=")]
    name = named[-1].partition("=")[2] if named else "sweep"
    others = [word for word in overrides if word not in named]
    store = None
    for table in FILLS.get(name, (name,)):
        found, _, store = answers([*([f"+experiment={table}"] if named else []), *others], store)
        console(build(table, found, None if named else Layout("This sweep", "Every scene and method that it spans.")))


def _attempt(argv: list[str]) -> str:
    """Let Hydra run the jobs; what ended it early, or ""."""
    try:
        _hydra(argv)
    except KeyboardInterrupt:
        raise
    except Exception as error:
        return f"the sweep ended early ({type(error).__name__}: {' '.join(str(error).split())[:200]})"
    return ""


def _end_with_the_sweep() -> None:
    """In a launcher's worker process: end when the process that started the sweep is gone, rather than idle on."""
    parent = os.environ.get(PARENT)
    if parent != str(os.getppid()):
        return

    def watch() -> None:
        while str(os.getppid()) == parent:
            time.sleep(0.5)
        os._exit(1)

    if not any(thread.name == watch.__name__ for thread in threading.enumerate()):
        threading.Thread(target=watch, name=watch.__name__, daemon=True).start()


def _report(follower: Follower) -> int:
    entries = follower.entries.values()
    ran = [entry for entry in entries if entry.ran]
    before = len(entries) - len(ran)
    missing = max(0, follower.total - follower.reached)
    bad = {status: n for status, n in follower.counts.items() if status != OK}
    parts = [f"{len(ran)} run" if ran else "nothing to run"]
    if before:
        parts.append(f"{before} done before")
    parts += [f"{n} {status}" for status, n in sorted(bad.items())]
    if missing:
        parts.append(f"{missing} not reached")
    plural = "" if follower.total == 1 else "s"
    print(f"{follower.total} trial{plural}: {', '.join(parts)}. Output: {follower.settings.output}")
    if any(not entry.ran and entry.status != OK for entry in entries):
        print("Trials that failed before are not repeated; rerun=failed runs them again.")
    if follower.trouble:
        print(f"{follower.trouble}; the trials are safe, 'harness sync' brings them in", file=sys.stderr)
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
