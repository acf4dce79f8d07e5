"""The verb ``plan``: what a run would do, without doing it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from datasets.body import DatasetError
from datasets.registry import load_scene
from harness.arguments import Parser
from harness.experiments import Settings, expand
from harness.memory import Size, foreseen_gb, refusal
from harness.record import OK, Outcome, Trial, digest
from harness.storage import read_record
from harness.trial import identify
from methods.base import Method, MethodError
from methods.registry import build_method
from reports.text import printable


@dataclass(frozen=True)
class Planned:
    """A trial of an experiment: its key, why it cannot run ("" when it can), and its record when it is done.

    ``foreseen_gb`` is the memory that it is going to take, where the method can say.
    """

    trial: Trial
    key: str
    reason: str
    outcome: Outcome | None
    foreseen_gb: float | None = None

    @property
    def state(self) -> str:
        if self.outcome is None:
            return "cannot run" if self.reason else "missing"
        return "done" if self.outcome.status == OK else self.outcome.status


def plan(overrides: Sequence[str]) -> tuple[list[Planned], Settings]:
    """Every trial of the overrides with what is known of it.

    Raises
    ------
    UsageError
        If the overrides cannot be composed.
    """
    trials = expand(overrides)
    planned: list[Planned] = []
    sizes: dict[str, Size | str] = {}
    for trial, settings in trials:
        key, reason = identify(trial, settings)
        outcome, need, why = read_record(settings.trials / key), None, str(reason or "")
        if outcome is None and not why:
            need, why = _memory(trial, settings, sizes)
        planned.append(Planned(trial, key, why, outcome, need))
    return planned, trials[0][1]


def _memory(trial: Trial, settings: Settings, sizes: dict[str, Size | str]) -> tuple[float | None, str]:
    """The memory in GB that a trial is going to take, and why it does not fit; each scene is made once for that."""
    method = build_method({k: v for k, v in trial.method.items() if k != "name"})
    if type(method).memory is Method.memory:
        return None, ""
    scene = digest(trial.dataset)
    if scene not in sizes:
        try:
            sizes[scene] = Size.of(load_scene(trial.dataset, settings.data, settings.missing == "stand_in"))
        except DatasetError as error:
            sizes[scene] = str(error)
    size = sizes[scene]
    if isinstance(size, str):
        return None, size
    try:
        return foreseen_gb(method, size), refusal(method, size, settings.memory_gb)
    except MethodError as error:
        return None, str(error)


def main(argv: Sequence[str]) -> int:
    """Print the plan; exit code 0 when nothing failed and nothing is in the way, else 2."""
    parser = Parser(
        "harness plan",
        description="What 'harness run' with the same overrides would do.",
        epilog="harness plan +experiment=table1\nharness plan method=ours,edsc noise.level=0,0.02",
    )
    parser.add_argument("overrides", nargs="*")
    planned, settings = plan(parser.read(argv).overrides)
    past = [o for o in map(read_record, sorted(settings.trials.glob("*/"))) if o is not None and o.status == OK]
    table = Table(box=None, pad_edge=False)
    for heading in ("trial", "state", "expected"):
        table.add_column(heading, overflow="fold")
    seconds, unknown, memory = 0.0, 0, 0.0
    for item in planned:
        expected = ""
        if item.state == "missing":
            like = [o for o in past if o.method == str(item.trial.method["name"])]
            same = [o for o in like if o.dataset == str(item.trial.dataset["name"])] or like
            if same:
                cost, size = median(o.seconds or 0 for o in same), max(o.peak_mb or 0 for o in same)
                size = size if item.foreseen_gb is None else 1024 * item.foreseen_gb
                seconds, memory, expected = seconds + cost, max(memory, size), f"{cost:.1f} s, {size:.0f} MB"
            else:
                unknown, expected = unknown + 1, "no past trial of this method"
                if item.foreseen_gb is not None:
                    memory = max(memory, 1024 * item.foreseen_gb)
                    expected += f", {1024 * item.foreseen_gb:.0f} MB"
        elif item.outcome is not None:
            expected = escape(printable(item.outcome.error))
        else:
            expected = escape(printable(item.reason))
        table.add_row(escape(printable(item.trial.title)), item.state, expected)
    console = Console(soft_wrap=False)
    console.print(table)
    count = {state: sum(i.state == state for i in planned) for state in dict.fromkeys(i.state for i in planned)}
    print(f"{len(planned)} trials: {', '.join(f'{n} {state}' for state, n in count.items())}.")
    if seconds or unknown:
        rest = f", and {unknown} of unknown length" if unknown else ""
        print(f"Expected: {seconds:.0f} s of one core{rest}; at most {memory:.0f} MB a trial.")
    return 0 if set(count) <= {"done", "missing"} else 2
