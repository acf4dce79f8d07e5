"""The verb ``run``: one trial or a sweep, as a Hydra application."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from nrsfm.harness.cli.parser import Parser
from nrsfm.harness.record.errors import UsageError

if TYPE_CHECKING:
    from nrsfm.harness.config.spans import Request
    from nrsfm.harness.sweep.conductor import Sweep

INFO = ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath")  # parts that Hydra shows


def main(argv: Sequence[str]) -> int:
    """Run the trials of the overrides and print a summary; returns the exit code.

    Raises
    ------
    UsageError
        If the command line or the overrides cannot be used; nothing has run then.
    OSError
        If the output folder cannot be written.
    """
    options = command_line().read(argv)
    _check(options)
    if options.hydra_help or options.version or options.cfg or options.info:
        return _show(options)
    from nrsfm.harness.config.spans import Request

    request = Request.of(options.overrides)
    if options.run and len(request.trials) > 1:
        raise UsageError(f"--run is for one trial and the overrides span {len(request.trials)}; leave it out")
    from nrsfm.harness.record.outcome import OK
    from nrsfm.harness.record.text import printable
    from nrsfm.harness.sweep.conductor import conduct

    sweep = conduct(request)
    if sweep.trouble:
        print(f"nrsfm run: {printable(sweep.trouble)}; start it again to run the rest", file=sys.stderr)
    if len(sweep.jobs) > 1 or options.multirun:
        _print_tables(request, sweep)
    _print_summary(sweep)
    complete = sweep.entries.keys() == sweep.jobs.keys() and sweep.counts.keys() <= {OK}
    return 0 if complete and not sweep.tracking_trouble else 2


def _check(options: argparse.Namespace) -> None:
    """Raise UsageError on flags of Hydra that this application has no use for, and on combinations of no meaning."""
    if options.config_name or options.config_path:
        raise UsageError("there is one configuration, config.yaml; --config-dir adds files to its groups")
    if options.experimental_rerun:
        raise UsageError("--experimental-rerun runs a pickled job; 'nrsfm run ... rerun=all' runs trials again")
    if options.shell_completion:
        raise UsageError("'nrsfm completion bash' prints the completion of bash, zsh or fish")
    if options.run and options.multirun:
        raise UsageError("--run is for one trial, --multirun for a sweep; give one of them")
    shown = [flag for flag in ("cfg", "info", "hydra_help", "version") if getattr(options, flag)]
    if len(shown) > 1:
        raise UsageError(f"--{shown[0]} and --{shown[1]} show different things; give one of them".replace("_", "-"))
    if options.multirun and (options.cfg or options.info):
        raise UsageError("--multirun spans several configurations, --cfg and --info show one; leave one of them out")
    if options.package is not None and not options.cfg:
        raise UsageError("--package is for --cfg; add --cfg job")
    if options.resolve and not options.cfg:
        raise UsageError("--resolve is for --cfg; add --cfg job")


def _show(options: argparse.Namespace) -> int:
    """Print what a flag of Hydra shows, without the logins of addresses."""
    from contextlib import redirect_stdout
    from io import StringIO

    from nrsfm.harness.config.address import shown
    from nrsfm.harness.config.compose import hydra_errors
    from nrsfm.harness.sweep.launcher import call_hydra

    words = [] if options.hydra_help else list(options.overrides)
    for flag in ("cfg", "info", "package"):
        if (value := getattr(options, flag)) is not None:
            words += [f"--{flag}", str(value)]
    words += [f"--{flag.replace('_', '-')}" for flag in ("hydra_help", "version", "resolve") if getattr(options, flag)]
    with hydra_errors(), redirect_stdout(StringIO()) as output:
        code = call_hydra(words)
    print(shown(output.getvalue()), end="")
    return 3 if code else 0


def _print_tables(request: Request, sweep: Sweep) -> None:
    """Print the tables that a sweep has filled."""
    from nrsfm.harness.record.tracked import Tracked
    from nrsfm.reports.formats.console import console
    from nrsfm.reports.layouts.index import FILLS
    from nrsfm.reports.layouts.sweep_table import span
    from nrsfm.reports.tables.build import build

    records = {job.trial.setting: job.record for job in sweep.jobs.values()}
    name = request.experiment or "sweep"
    layout = None if request.experiment else span([trial for trial, _ in request.trials])
    for table in FILLS.get(name, (name,)):
        trials = request.trials if table == name else request.with_experiment(table).trials
        pairs = ((trial, records.get(trial.setting)) for trial, _ in trials)
        answers = [(trial, Tracked(record, "", "") if record else None) for trial, record in pairs]
        console(build(table, answers, layout))


def _print_summary(sweep: Sweep) -> None:
    """Print how many trials ran, were done before, failed or are missing, and what kept them from the tracker."""
    from nrsfm.harness.config.address import is_server, shown
    from nrsfm.harness.record.outcome import OK
    from nrsfm.harness.record.text import printable

    entries, total = sweep.entries.values(), len(sweep.jobs)
    ran = sum(entry.ran for entry in entries)
    parts = [f"{ran} run" if ran else "nothing to run"]
    if before := len(entries) - ran:
        parts.append(f"{before} done before")
    parts += [f"{n} {status}" for status, n in sorted(sweep.counts.items()) if status != OK]
    if missing := total - len(entries):
        parts.append(f"{missing} not reached")
    print(f"{total} trial{'' if total == 1 else 's'}: {', '.join(parts)}. Output: {sweep.settings.output}")
    if any(not entry.ran and entry.status != OK for entry in entries):
        print("Trials that failed before are not repeated; rerun=failed runs them again.")
    if stale := sum(not entry.ran and sweep.jobs[entry.key].stale for entry in entries):
        print(f"The code or a library changed since {stale} of them ran; rerun=stale runs these again.")
    if trouble := sweep.tracking_trouble:
        uri = shown(sweep.settings.tracking_uri)
        place = f" tracking=server tracking.uri={uri}" if is_server(uri) else ""
        remedy = "" if "'nrsfm sync" in trouble else f", 'nrsfm sync{place}' brings them in"
        print(f"{printable(trouble)}; the trials are safe{remedy}", file=sys.stderr)


def command_line() -> Parser:
    """The parser: every flag of Hydra, those without a use here hidden and refused."""
    parser = Parser(
        "nrsfm run",
        "Run one trial, a sweep, or an experiment. What is done already is not repeated.",
        """\
nrsfm run  # one trial on generated bodies, by conf/config.yaml
nrsfm run dataset=dance_yoga method=adaptive  # one trial on two real sequences
nrsfm run dataset=procedural 'dataset.bodies=[person,face]' dataset.points=20 dataset.frames=40
nrsfm run dataset=dance_yoga,face_yoga method=adaptive,edsc noise.level=0,0.02  # a sweep: 8 trials
nrsfm run experiment=table1  # what table 1 of the paper asks
nrsfm run experiment=table2 method=adaptive,bmm_ssc3d cameras=estimated  # the same table, changed
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
    text = f"show what Hydra found of {', '.join(INFO)}, and run nothing"
    parser.add_argument("-i", "--info", nargs="?", const="all", choices=INFO, metavar="PART", help=text)
    parser.add_argument("-r", "--run", action="store_true", help="one trial; overrides that span a sweep are refused")
    parser.add_argument("--version", action="store_true", help="Hydra's version")
    parser.add_argument("--hydra-help", action="store_true", help="Hydra's own help")
    for flags in (("-cn", "--config-name"), ("-cp", "--config-path"), ("--experimental-rerun",)):
        parser.add_argument(*flags, help=argparse.SUPPRESS)
    parser.add_argument("-sc", "--shell-completion", action="store_true", help=argparse.SUPPRESS)
    return parser
