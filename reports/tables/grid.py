"""Sorts answers into rows and columns: which runs may be averaged, and which may not stand in one cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Protocol

from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.tracked import Answer
from nrsfm.harness.record.trial import Trial, digest, gap_words
from nrsfm.reports.layouts.layout import Layout, Method, scene_words, setting_text
from nrsfm.reports.tables.model import Setting


class Tracked(Protocol):
    """A run that the tracker knows."""

    @property
    def outcome(self) -> Outcome: ...
    @property
    def run_id(self) -> str: ...
    @property
    def uri(self) -> str: ...


Place = tuple[str, Setting]


@dataclass(frozen=True)
class RowKey:
    """Real data and stand-ins never share a row, and neither do two settings."""

    dataset: str
    setting: Setting
    stand_in: bool = False


@dataclass
class Grid:
    """Answers by row and method's key, rows in the order of the table, and the methods in the order of asking."""

    rows: dict[RowKey, dict[str, list[Answer]]]
    methods: tuple[Method, ...]

    @property
    def settings(self) -> tuple[Setting, ...]:
        return tuple(dict.fromkeys(key.setting for key in self.rows))


def grid(answers: Sequence[Answer], design: Layout) -> Grid:
    """Sort answers into the rows of a table and its methods.

    Parameters
    ----------
    answers : sequence of (Trial, Tracked or None)
        What was asked, and the run that answers it.
    design : Layout
        The paper's rows all appear, asked for or not, before any other.

    Returns
    -------
    Grid
    """
    places = [_place(trial, design) for trial, _ in answers]
    real, generated = _kinds(answers, places)
    found: dict[RowKey, dict[str, list[Answer]]] = {}
    methods: dict[str, Method] = {}
    for answer, place in zip(answers, places, strict=True):
        dataset, setting = place
        method = design.method(asdict(answer[0]))
        methods.setdefault(method.key, method)
        stand_in = _stand_in(answer[1], only=place in generated and place not in real)
        for row in design.rows(dataset):
            found.setdefault(RowKey(row, setting, stand_in), {}).setdefault(method.key, []).append(answer)
    settings = list(dict.fromkeys(key.setting for key in found))
    blank = settings[0] if len(settings) == 1 else Setting()
    asked = {key.dataset for key in found}
    found |= {RowKey(dataset, blank): {} for dataset in design.datasets if dataset not in asked}
    datasets = list(dict.fromkeys([*design.datasets, *(key.dataset for key in found)]))
    settings = list(dict.fromkeys([*settings, blank]))
    order = sorted(found, key=lambda key: (datasets.index(key.dataset), settings.index(key.setting), key.stand_in))
    return Grid({key: found[key] for key in order}, tuple(methods.values()))


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


def _kinds(answers: Sequence[Answer], places: Sequence[Place]) -> tuple[set[Place], set[Place]]:
    """Places with finished runs on real data, and on generated data."""
    real, generated = set(), set()
    for (_, run), place in zip(answers, places, strict=True):
        if run is not None and run.outcome.stand_in:
            generated.add(place)
        elif run is not None and run.outcome.status == OK:
            real.add(place)
    return real, generated


def _stand_in(run: Tracked | None, only: bool) -> bool:
    """A run that never finished may not know its data; it goes with the others of its row."""
    if run is not None and (run.outcome.stand_in or run.outcome.status == OK):
        return run.outcome.stand_in
    return only


def _place(trial: Trial, design: Layout) -> Place:
    """The dataset and the setting of a trial, without what tells columns apart."""
    cameras = one_line(trial.cameras.get("source", "known"))
    return one_line(trial.dataset["name"]), Setting(
        cameras="" if "cameras.source" in design.column_settings else cameras,
        placement=setting_text(trial.dataset.get("placement", "")),
        motion=setting_text(trial.dataset.get("motion", "")),
        scene=scene_words(trial.dataset),
        level=float(trial.noise.get("level", 0.0)),
        gaps=one_line(gap_words(trial.gaps)),
        bodies=trial.n_bodies,
    )
