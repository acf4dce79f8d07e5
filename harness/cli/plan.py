"""The verb ``plan``: print what a run would do."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from nrsfm.harness.cli.parser import Parser

if TYPE_CHECKING:
    from rich.table import Table

    from nrsfm.harness.sweep.plan import Plan, Planned

ROWS = 40  # of more trials, a row for each method and state
WIDTH = 120  # of the table when the output is not a terminal


def main(argv: Sequence[str]) -> int:
    """Print the plan; exit code 0 when nothing failed and nothing is in the way, else 2."""
    options = command_line().read(argv)
    from rich.console import Console

    from nrsfm.harness.sweep.plan import plan

    planned = plan(options.overrides)
    if options.json:
        print(json.dumps(_plain(planned), indent=1))
    else:
        console = Console()
        if not console.is_terminal:
            console = Console(width=WIDTH, color_system=None)
        console.print(_table(planned) if options.all or len(planned.trials) <= ROWS else _summary(planned))
        for line in _lines(planned):
            print(line)
    clear = all(item.runs or item.state == "done" for item in planned.trials)
    return 0 if clear and planned.fits and not any(item.reason for item in planned.trials) else 2


def _table(plan: Plan) -> Table:
    """A row for each trial."""
    from rich.text import Text

    from nrsfm.harness.record.text import printable

    table = _grid("trial", "state", "time", "memory", "disk")
    for item in plan.trials:
        table.add_row(Text(printable(item.title)), Text(item.state), *_numbers([item]), Text(printable(item.words)))
    return table


def _summary(plan: Plan) -> Table:
    """A row for each method and state: sums of time and disk, and the memory of the largest trial."""
    from rich.text import Text

    from nrsfm.harness.record.text import printable

    groups: dict[tuple[str, str], list[Planned]] = {}
    for item in plan.trials:
        groups.setdefault((item.state, str(item.trial.method["name"])), []).append(item)
    table = _grid("method", "state", "trials", "time, sum", "memory", "disk, sum")
    for (state, method), items in groups.items():
        words = list(dict.fromkeys(item.words for item in items if item.words))
        said = f"{words[0]}; {len(words) - 1} more with --all" if len(words) > 1 else "".join(words)
        table.add_row(Text(printable(method)), Text(state), str(len(items)), *_numbers(items), Text(printable(said)))
    return table


def _grid(*headings: str) -> Table:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for i, heading in enumerate((*headings, "")):
        number = 2 <= i < len(headings)
        table.add_column(heading, overflow="fold", justify="right" if number else "left", no_wrap=number)
    return table


def _numbers(items: Sequence[Planned]) -> tuple[str, str, str]:
    """Time, memory and disk of trials; empty where nothing runs or nothing is known."""
    from nrsfm.harness.sweep.forecast import size_words, time_words

    known = [item.forecast for item in items if item.forecast and not item.reason]
    memory = max((item.memory_mb or 0.0 for item in items if not item.reason), default=0.0)
    return (
        time_words(sum(f.seconds for f in known)) if known else "",
        size_words(memory) if memory else "",
        size_words(sum(f.disk_mb for f in known)) if known else "",
    )


def _lines(plan: Plan) -> Iterator[str]:
    """The sums below the table, and what may come in the way."""
    from nrsfm.harness.record.environment import cores
    from nrsfm.harness.sweep.forecast import size_words, time_words

    yield f"{_trials(len(plan.trials))}: {', '.join(f'{n} {state}' for state, n in plan.counts.items())}."
    if not plan.to_run:
        yield "Nothing to run."
    else:
        on = f"{plan.workers} worker{'' if plan.workers == 1 else 's'}"
        on += f" of {cores()} cores" if plan.here else ""
        said = [f"{time_words(plan.wall_seconds)} on {on}, {time_words(plan.cpu_seconds)} of CPU time"]
        said = said if plan.known else []
        if plan.unknown:
            said.append(f"{_trials(plan.unknown)} of unknown length")
        if plan.memories[0]:
            said.append(f"at most {size_words(plan.memories[0])} of memory a trial")
        if plan.known:
            said.append(f"{size_words(plan.disk_mb)} of disk, {size_words(plan.free_mb)} are free")
        yield f"To run: {len(plan.to_run)}. Expected: {'; '.join(said) or 'nothing that can run'}."
    yield from (f"! {warning}" for warning in plan.warnings)


def _trials(n: int) -> str:
    return f"{n} trial{'' if n == 1 else 's'}"


def _plain(plan: Plan) -> dict[str, Any]:
    """The plan as JSON has it; what is not known is left out."""
    from nrsfm.harness.record.environment import cores

    return {
        "counts": dict(plan.counts),
        "to_run": len(plan.to_run),
        "unknown": plan.unknown,
        "workers": plan.workers,
        "cores": cores(),
        "wall_seconds": round(plan.wall_seconds, 2),
        "cpu_seconds": round(plan.cpu_seconds, 2),
        "memory_mb": round(plan.memories[0], 1),
        "disk_mb": round(plan.disk_mb, 2),
        "free_mb": round(plan.free_mb),
        "warnings": list(plan.warnings),
        "trials": [_row(item) for item in plan.trials],
    }


def _row(item: Planned) -> dict[str, Any]:
    forecast = item.forecast
    row = {
        "key": item.key,
        "title": item.title,
        "dataset": item.trial.dataset["name"],
        "method": item.trial.method["name"],
        "state": item.state,
        "runs": item.runs,
        "reason": item.reason or (item.outcome.error if item.outcome else ""),
        "seconds": forecast and round(forecast.seconds, 3),
        "cpu_seconds": forecast and round(forecast.cpu_seconds, 3),
        "memory_mb": item.memory_mb and round(item.memory_mb, 1),
        "disk_mb": forecast and round(forecast.disk_mb, 3),
        "basis": forecast and forecast.basis,
    }
    return {name: value for name, value in row.items() if value not in (None, "")}


def command_line() -> Parser:
    parser = Parser(
        "nrsfm plan",
        "Say what 'nrsfm run' would do with the same overrides. Trials done, missing and failed are told apart, "
        "with the time, the memory and the disk that they will take.",
        """\
nrsfm plan experiment=table1
nrsfm plan method=adaptive,edsc noise.level=0,0.02 workers=4
nrsfm plan experiment=noise rerun=failed  # what 'nrsfm run' would repeat
nrsfm plan experiment=noise --all  # every trial, not methods and states
nrsfm plan experiment=noise --json  # for machines
nrsfm plan experiment=dense_full limits.memory_gb=4  # what does not fit is refused before it runs""",
        "Time is the median of past trials of the method and size, and unknown where there are none; the time of the\n"
        "nearest size is then named.\n\n"
        "exit codes: 0 nothing failed for good and nothing is in the way, 2 otherwise, 3 usage",
    )
    parser.add_overrides()
    parser.add_argument("-m", "--multirun", action="store_true", help="as of 'nrsfm run'; changes nothing here")
    parser.add_argument("--all", action="store_true", help="a row for every trial, however many there are")
    parser.add_argument("--json", action="store_true", help="every trial and the sums, for machines")
    return parser
