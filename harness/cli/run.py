"""The verb ``run``: one trial or a sweep, as a Hydra application."""

from __future__ import annotations

import secrets
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from datetime import datetime
from io import StringIO
from pathlib import Path

from hydra._internal.utils import get_args_parser

from nrsfm.harness.cli.parser import Parser
from nrsfm.harness.config.address import is_server, shown
from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import expand
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.record.outcome import OK
from nrsfm.harness.record.text import printable
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.sweep.conductor import _carry_out, _hydra, _interruptible
from nrsfm.harness.sweep.follower import Follower
from nrsfm.harness.sweep.launcher import Launcher
from nrsfm.harness.sweep.work import Job
from nrsfm.harness.tracking.writer import prepare
from nrsfm.harness.trial.execute import identify, repeats
from nrsfm.harness.trial.isolation import start_server
from nrsfm.harness.trial.journal import journal


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
        raise UsageError(f"{unknown[0]} is no option of 'nrsfm run'; see 'nrsfm run --help'")
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
        print(f"nrsfm run: {printable(trouble)}; start it again to run the rest", file=sys.stderr)
    if len(jobs) > 1 or asked.multirun:
        _show(overrides, trials)
    return _report(follower)


def _show(overrides: Sequence[str], trials: Sequence[tuple[Trial, Settings]]) -> None:
    """Print the tables that a sweep of these trials has just filled."""
    from nrsfm.harness.tracking.runs import recorded
    from nrsfm.reports.formats.console import console
    from nrsfm.reports.layouts.index import FILLS
    from nrsfm.reports.layouts.sweep_table import span
    from nrsfm.reports.tables.build import build

    named = [word for word in overrides if word.lstrip("+").startswith("experiment=")]
    name = named[-1].partition("=")[2] if named else "sweep"
    others = [word for word in overrides if word not in named]
    for table in FILLS.get(name, (name,)):
        asked = trials if table == name else expand([f"experiment={table}", *others])
        found = recorded(asked)
        console(build(table, found, None if named else span([trial for trial, _ in trials])))


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
        remedy = "" if "'nrsfm sync" in follower.trouble else f", 'nrsfm sync{place}' brings them in"
        print(f"{printable(follower.trouble)}; the trials are safe{remedy}", file=sys.stderr)
    return 2 if bad or missing or follower.trouble else 0


def _name() -> str:
    return f"{datetime.now():%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"


def command_line() -> Parser:
    """Shows and completes what Hydra parses."""
    parser = Parser(
        "nrsfm run",
        "Run one trial, a sweep, or an experiment. What is done already is not repeated.",
        """\
nrsfm run  # one trial on generated bodies, by conf/config.yaml
nrsfm run dataset=dance_yoga method=ours  # one trial on two real sequences
nrsfm run dataset=procedural 'dataset.bodies=[person,face]' dataset.points=20 dataset.frames=40
nrsfm run dataset=dance_yoga,face_yoga method=ours,edsc noise.level=0,0.02  # a sweep: 8 trials
nrsfm run experiment=table1  # what table 1 of the paper asks
nrsfm run experiment=table2 method=ours,bmm_ssc3d cameras=estimated  # the same table, changed
nrsfm run experiment=table1 rerun=failed workers=4  # what failed, on four processes
nrsfm run experiment=noise hydra/launcher=joblib  # workers of another launcher
nrsfm run --cfg job method=edsc  # the configuration, and nothing runs""",
        "A group takes the name of one of its files, 'nrsfm list' names them; a key takes a value: 'nrsfm run\n"
        "--cfg job' shows all keys. A comma spans a sweep. NRSFM_OUTPUT names the folder to write to, NRSFM_DATA\n"
        "that of the real sequences. Values that hold brackets or spaces want quotes: 'dataset.placement=[3,0,0]'.\n\n"
        "run is a Hydra application: 'nrsfm run --hydra-help' explains Hydra's own flags.\n\n"
        "exit codes: 0 every trial is ok, 2 one is missing or failed, 3 usage; then nothing has run",
    )
    parser.add_overrides()
    parser.add_argument("-m", "--multirun", action="store_true", help="a sweep; a comma in an override says it as well")
    parser.add_argument("-c", "--cfg", choices=["job", "hydra", "all"], help="show the configuration and run nothing")
    parser.add_argument("-p", "--package", metavar="KEY", help="with --cfg: show this part of it alone")
    parser.add_argument("--resolve", action="store_true", help="with --cfg: put values in the place of ${...}")
    parts = ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath")
    text = f"show what Hydra has found of {', '.join(parts)}, and run nothing"
    parser.add_argument("-i", "--info", choices=parts, metavar="PART", help=text)
    parser.add_argument("-cd", "--config-dir", type=Path, metavar="FOLDER", help="add the files of a tree like conf/")
    parser.add_argument("--hydra-help", action="store_true", help="Hydra's own help")
    return parser
