"""The verb ``run``: one trial or a sweep, as a Hydra application."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from hydra._internal.utils import get_args_parser

from nrsfm.harness.cli.parser import Parser
from nrsfm.harness.config.address import is_server, shown
from nrsfm.harness.config.spans import expand
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.outcome import OK
from nrsfm.harness.record.text import printable
from nrsfm.harness.record.tracked import Tracked
from nrsfm.harness.sweep.application import call_hydra
from nrsfm.harness.sweep.conductor import Sweep, conduct


def main(argv: Sequence[str]) -> int:
    """Run the trials of the overrides and print a summary; returns the exit code.

    Raises
    ------
    UsageError
        If the command line or the overrides cannot be used; nothing has run then.
    OSError
        If the output folder cannot be written.
    """
    options, unknown = get_args_parser().parse_known_args(list(argv))
    if unknown:
        raise UsageError(f"{unknown[0]} is no option of 'nrsfm run'; see 'nrsfm run --help'")
    if options.config_name or options.config_path:
        raise UsageError("there is one configuration, config.yaml; --config-dir adds files to its groups")
    overrides = list(options.overrides)
    if options.config_dir:
        overrides.append(f"hydra.searchpath=[file://{Path(options.config_dir).resolve()}]")
    if options.hydra_help or options.cfg or options.info or options.shell_completion:
        with redirect_stdout(StringIO()) as output:
            code = call_hydra(argv)
        print(shown(output.getvalue()), end="")
        return code
    sweep = conduct(overrides)
    if sweep.trouble:
        print(f"nrsfm run: {printable(sweep.trouble)}; start it again to run the rest", file=sys.stderr)
    if len(sweep.jobs) > 1 or options.multirun:
        _print_tables(overrides, sweep)
    _print_summary(sweep)
    complete = sweep.entries.keys() == sweep.jobs.keys() and sweep.counts.keys() <= {OK}
    return 0 if complete and not sweep.tracking_trouble else 2


def _print_tables(overrides: Sequence[str], sweep: Sweep) -> None:
    """Print the tables that a sweep has filled."""
    from nrsfm.reports.formats.console import console
    from nrsfm.reports.layouts.index import FILLS
    from nrsfm.reports.layouts.sweep_table import span
    from nrsfm.reports.tables.build import build

    records = {job.trial.setting: job.record for job in sweep.jobs.values()}
    trials = [job.trial for job in sweep.jobs.values()]
    experiments = [word for word in overrides if word.lstrip("+").startswith("experiment=")]
    name = experiments[-1].partition("=")[2] if experiments else "sweep"
    others = [word for word in overrides if word not in experiments]
    for table in FILLS.get(name, (name,)):
        rows = trials if table == name else [trial for trial, _ in expand([f"experiment={table}", *others])]
        pairs = ((trial, records.get(trial.setting)) for trial in rows)
        answers = [(trial, Tracked(record, "", "") if record else None) for trial, record in pairs]
        console(build(table, answers, None if experiments else span(trials)))


def _print_summary(sweep: Sweep) -> None:
    """Print how many trials ran, were done before, failed, or are missing, and what kept them from the tracker."""
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
    if trouble := sweep.tracking_trouble:
        uri = shown(sweep.settings.tracking_uri)
        place = f" tracking=server tracking.uri={uri}" if is_server(uri) else ""
        remedy = "" if "'nrsfm sync" in trouble else f", 'nrsfm sync{place}' brings them in"
        print(f"{printable(trouble)}; the trials are safe{remedy}", file=sys.stderr)


def command_line() -> Parser:
    """The parser that prints the help and completes words; Hydra parses the command line itself."""
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
