"""The layout of a sweep that belongs to no table: a column for each combination of settings that it spans."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nrsfm.harness.record.parameters import flatten
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.trial import Trial
from nrsfm.reports.layouts.labels import method_label
from nrsfm.reports.layouts.layout import SCENE, Layout, Method

#: Settings in which rows differ, not columns.
ROWS = frozenset(
    {"dataset.name", "dataset.placement", "dataset.motion", "cameras.source", *(f"dataset.{name}" for name in SCENE)}
)


def span(trials: Sequence[Trial]) -> Layout:
    """A layout with a column for each method and each combination of other settings that the trials differ in.

    A setting of the dataset counts where scenes of one name differ in it, one of the method where trials of one method
    do.
    """
    plain = [flatten({"dataset": t.dataset, "method": t.method, "cameras": t.cameras}) for t in trials]
    spanned: dict[str, dict[str, None]] = {}
    for group, name in (("dataset", "dataset.name"), ("method", "method.name"), ("cameras", "cameras.source")):
        seen: dict[tuple[Any, str], Any] = {}
        for settings in plain:
            for path in (path for path in settings if path.startswith(f"{group}.") and path not in ROWS):
                if str(seen.setdefault((settings[name], path), settings[path])) != str(settings[path]):
                    spanned.setdefault(group, {})[path] = None
    paths = [path for group in spanned.values() for path in group]
    columns: dict[str, Method] = {}
    for settings in plain:
        where = {path: settings[path] for path in paths if path in settings}
        words = ", ".join(f"{path.partition('.')[2]} {one_line(str(value))}" for path, value in where.items())
        name = settings["method.name"]
        label = f"{method_label(name)}, {words}" if words else ""
        column = Method(name, where=where, label=label)
        columns.setdefault(column.key, column)
    return Layout("This sweep", "Every scene and method that it spans.", tuple(columns.values()))
