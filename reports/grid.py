"""Sorts answers into rows and columns: which runs may be averaged, and which may not stand in one cell."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

from harness.record import OK, Outcome, Trial, digest
from reports.model import Setting
from reports.text import one_line


class Tracked(Protocol):
    """A run that the tracker knows."""

    @property
    def outcome(self) -> Outcome: ...
    @property
    def run_id(self) -> str: ...
    @property
    def uri(self) -> str: ...


Answer = tuple[Trial, Tracked | None]


@dataclass(frozen=True)
class RowKey:
    """Real data and stand-ins never share a row, and neither do two settings."""

    dataset: str
    setting: Setting
    stand_in: bool = False


@dataclass
class Grid:
    """Answers by row and method, rows in the order of the table."""

    rows: dict[RowKey, dict[str, list[Answer]]] = field(default_factory=dict)

    @property
    def methods(self) -> tuple[str, ...]:
        """Methods asked for, in the order of asking."""
        return tuple(dict.fromkeys(method for cells in self.rows.values() for method in cells))

    @property
    def settings(self) -> tuple[Setting, ...]:
        return tuple(dict.fromkeys(key.setting for key in self.rows))


def grid(
    answers: Sequence[Answer], printed: Sequence[str], rows: Callable[[str], Sequence[str]] = lambda dataset: (dataset,)
) -> Grid:
    """Sort answers into the rows of a table.

    Parameters
    ----------
    answers : sequence of (Trial, Tracked or None)
        What was asked, and the run that answers it.
    printed : sequence of str
        The paper's rows; all of them appear, asked for or not, before any other.
    rows : callable
        The rows that a dataset counts in; its own by default.

    Returns
    -------
    Grid
    """
    real, generated = _kinds(answers)
    found: dict[RowKey, dict[str, list[Answer]]] = {}
    for answer in answers:
        dataset, setting = place = _place(answer)
        stand_in = _stand_in(answer[1], only=place in generated and place not in real)
        for row in rows(dataset):
            cells = found.setdefault(RowKey(row, setting, stand_in), {})
            cells.setdefault(one_line(answer[0].method["name"]), []).append(answer)
    settings = list(dict.fromkeys(key.setting for key in found))
    blank = settings[0] if len(settings) == 1 else Setting()
    asked = {key.dataset for key in found}
    found |= {RowKey(dataset, blank): {} for dataset in printed if dataset not in asked}
    datasets = list(dict.fromkeys([*printed, *(key.dataset for key in found)]))
    settings = list(dict.fromkeys([*settings, blank]))
    order = sorted(found, key=lambda key: (datasets.index(key.dataset), settings.index(key.setting), key.stand_in))
    return Grid({key: found[key] for key in order})


def repeats(answers: Sequence[Answer], pooled: bool = False) -> list[list[Answer]]:
    """Answers of one cell by what was asked, the noise's repeat aside: only those of one group may be averaged.

    In a pooled row the dataset does not set them apart either.
    """
    groups: dict[str, dict[str, Answer]] = {}
    for trial, run in sorted(answers, key=lambda answer: answer[1] is None):
        asked = asdict(trial) | {"noise": {k: v for k, v in trial.noise.items() if k != "repeat"}}
        if pooled:
            del asked["dataset"]
        groups.setdefault(digest(asked), {}).setdefault(trial.setting, (trial, run))
    return [list(group.values()) for group in groups.values()]


def _kinds(answers: Sequence[Answer]) -> tuple[set[Any], set[Any]]:
    """Places with finished runs on real data, and on generated data."""
    real, generated = set(), set()
    for answer in answers:
        run = answer[1]
        if run is not None and run.outcome.stand_in:
            generated.add(_place(answer))
        elif run is not None and run.outcome.status == OK:
            real.add(_place(answer))
    return real, generated


def _stand_in(run: Tracked | None, only: bool) -> bool:
    """A run that never finished may not know its data; it goes with the others of its row."""
    if run is not None and (run.outcome.stand_in or run.outcome.status == OK):
        return run.outcome.stand_in
    return only


def _place(answer: Answer) -> tuple[str, Setting]:
    trial = answer[0]
    setting = Setting(
        cameras=one_line(trial.cameras.get("source", "known")),
        placement=_word(trial.dataset, "placement"),
        motion=_word(trial.dataset, "motion"),
        level=float(trial.noise.get("level", 0.0)),
        gaps=one_line(f"{trial.gaps['kind']} {trial.gaps['share']:g}") if trial.gaps else "",
        bodies=trial.n_bodies,
    )
    return one_line(trial.dataset["name"]), setting


def _word(group: Mapping[str, Any], name: str) -> str:
    value = group.get(name, "")
    return one_line(value) if isinstance(value, str) else json.dumps([float(v) for v in value])
