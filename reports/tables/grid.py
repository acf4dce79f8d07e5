"""Sorts answers into the rows and columns of a table, and decides which runs may be averaged in a cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from nrsfm.harness.record.outcome import OK
from nrsfm.harness.record.parameters import flatten
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.tracked import Answer, Tracked
from nrsfm.harness.record.trial import (
    Trial,
    corruption_words,
    differing_keys,
    digest,
    gap_words,
    observation_words,
)
from nrsfm.reports.layouts.layout import SCENE, Layout, Method, scene_words, setting_text
from nrsfm.reports.tables.model import Setting

Place = tuple[str, Setting]


@dataclass(frozen=True)
class RowKey:
    """What the runs of a row have in common: the dataset, the setting, and real or generated data."""

    dataset: str
    setting: Setting
    stand_in: bool = False


@dataclass
class Grid:
    """Answers by row and by the key of their method; rows in the table's order, methods in the order of the trials."""

    rows: dict[RowKey, dict[str, list[Answer]]]
    methods: tuple[Method, ...]

    @property
    def settings(self) -> tuple[Setting, ...]:
        return tuple(dict.fromkeys(key.setting for key in self.rows))


def grid(answers: Sequence[Answer], design: Layout) -> Grid:
    """Sort answers into the rows of a table and its methods; the layout's rows come first, with trials or without."""
    swept = _swept([trial for trial, _ in answers], design)
    places = [_place(trial, design, swept) for trial, _ in answers]
    kinds: dict[Place, set[bool | None]] = {}
    for (_, run), place in zip(answers, places, strict=True):
        kinds.setdefault(place, set()).add(_stand_in(run))
    found: dict[RowKey, dict[str, list[Answer]]] = {}
    methods: dict[str, Method] = {}
    for answer, place in zip(answers, places, strict=True):
        dataset, setting = place
        method = design.method(asdict(answer[0]))
        methods.setdefault(method.key, method)
        stand_in = _stand_in(answer[1])
        if stand_in is None:  # it goes with its row
            stand_in = kinds[place] - {None} == {True}
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
    """Answers of one cell in groups that differ in the noise's repeat alone: only those of one group may be averaged.

    In a pooled row the answers of a group differ in the dataset, too.
    """
    groups: dict[str, dict[str, Answer]] = {}
    for trial, run in sorted(answers, key=lambda answer: answer[1] is None):
        settings = asdict(trial) | {"noise": {k: v for k, v in trial.noise.items() if k != "repeat"}}
        if pooled:
            del settings["dataset"]
        groups.setdefault(digest(settings), {}).setdefault(trial.setting, (trial, run))
    return [list(group.values()) for group in groups.values()]


def _stand_in(run: Tracked | None) -> bool | None:
    """Whether a run is on generated data; None for one that did not finish and may not know."""
    known = run is not None and (run.outcome.stand_in or run.outcome.status == OK)
    return run.outcome.stand_in if run is not None and known else None


def _swept(trials: Sequence[Trial], design: Layout) -> tuple[str, ...]:
    """Settings of the dataset in which scenes of one name differ, but for those that columns or the row tell anyway."""
    told = {"placement", "motion", *SCENE, *(path.removeprefix("dataset.") for m in design.methods for path in m.where)}
    alike: dict[str, list[dict[str, Any]]] = {}
    for trial in trials:
        alike.setdefault(trial.dataset["name"], []).append(flatten(trial.dataset))
    keys = dict.fromkeys(key for scenes in alike.values() for key in differing_keys(scenes))
    return tuple(key for key in keys if key not in told)


def _place(trial: Trial, design: Layout, swept: Sequence[str]) -> Place:
    """The dataset and the setting of a trial, without the settings in which columns differ."""
    scene = flatten(trial.dataset)
    words = [scene_words(trial.dataset), *(f"{key} {setting_text(scene[key])}" for key in swept if key in scene)]
    by_column = {path for method in design.methods for path in method.where}
    return one_line(trial.dataset["name"]), Setting(
        cameras="" if "cameras.source" in by_column else one_line(trial.cameras.get("source", "known")),
        placement=setting_text(trial.dataset.get("placement", "")),
        motion=setting_text(trial.dataset.get("motion", "")),
        scene=", ".join(filter(None, words)),
        level=float(trial.noise.get("level", 0.0)),
        gaps=one_line(gap_words(trial.gaps)),
        corruption=one_line(corruption_words(trial.corruption)),
        observations="" if "observations.robust" in by_column else observation_words(trial.observations),
        bodies=trial.n_bodies,
    )
