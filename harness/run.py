"""The verb ``run``: one trial or a sweep, as a Hydra application."""

from __future__ import annotations

import secrets
import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime

import hydra
from omegaconf import DictConfig

from harness.experiments import compose_config, grid, read, sweep_arguments
from harness.follow import Follower
from harness.record import OK
from harness.trial import execute, journal

HYDRA_FLAGS = {"--help", "-h", "--hydra-help", "--version", "--cfg", "-c", "--info", "-i", "--shell-completion", "-sc"}


@hydra.main(config_path="pkg://conf", config_name="config", version_base="1.3")
def job(cfg: DictConfig) -> str:
    """One trial of a run or sweep; its failure is an outcome, never an exception."""
    trial, settings = read(cfg)
    outcome, _ = execute(trial, settings)
    return outcome.status


def main(argv: Sequence[str]) -> int:
    """Run what the overrides ask for; returns the exit code.

    Raises
    ------
    UsageError
        If the overrides cannot be composed.
    """
    if any(word.split("=")[0] in HYDRA_FLAGS for word in argv):
        return _hydra(list(argv))
    flags = [word for word in argv if word.startswith("-")]
    overrides = [word for word in argv if not word.startswith("-")]
    jobs = grid(overrides)
    if len(jobs) > 1 and not {"-m", "--multirun"} & set(flags):
        flags = [*flags, "--multirun"]
    _, settings = read(compose_config(jobs[0]))
    settings = replace(settings, sweep=settings.sweep or _name())
    journal(settings.output, settings.sweep).parent.mkdir(parents=True, exist_ok=True)
    arguments = [*flags, *overrides, *sweep_arguments(overrides), f"sweep={settings.sweep}"]
    with Follower(settings, len(jobs)) as follower:
        code = _hydra(arguments)
    return _report(follower) or code


def _report(follower: Follower) -> int:
    ran = [entry for entry in follower.entries if entry.ran]
    before = len(follower.entries) - len(ran)
    missing = follower.total - len(follower.entries)
    bad = {status: n for status, n in follower.counts.items() if status != OK}
    parts = [f"{len(ran)} run" if ran else "nothing to run"]
    if before:
        parts.append(f"{before} done before")
    parts += [f"{n} {status}" for status, n in sorted(bad.items())]
    if missing:
        parts.append(f"{missing} not reached")
    plural = "" if follower.total == 1 else "s"
    print(f"{follower.total} trial{plural}: {', '.join(parts)}. Output: {follower.settings.output}")
    if any(not entry.ran and entry.status != OK for entry in follower.entries):
        print("Trials that failed before are not repeated; rerun=failed runs them again.")
    if follower.trouble:
        print(f"{follower.trouble}; the trials are safe, 'harness sync' brings them in", file=sys.stderr)
    return 2 if bad or missing or follower.trouble else 0


def _hydra(argv: list[str]) -> int:
    """Hydra's own command line; its exit code."""
    before = sys.argv
    sys.argv = ["harness run", *argv]
    try:
        job()
    except SystemExit as stop:
        return int(stop.code or 0)
    finally:
        sys.argv = before
    return 0


def _name() -> str:
    return f"{datetime.now():%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"
