"""The layout of a sweep that belongs to no table: columns for the settings that it spans and no row tells."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.trial import Trial
from nrsfm.reports.layouts.labels import method_label
from nrsfm.reports.layouts.layout import SCENE, Layout, Method

#: What rows are called by, or averaged over.
ROWS = frozenset(
    {"dataset.name", "dataset.placement", "dataset.motion", "cameras.source", *(f"dataset.{name}" for name in SCENE)}
)


def span(trials: Sequence[Trial]) -> Layout:
    """A layout with a column for each method and each combination of other settings that the trials differ in.

    A setting of the dataset tells columns apart where scenes of one name differ in it, one of the method where trials
    of one method do.
    """
    plain = [dict(_flat({name: asdict(trial)[name] for name in ("dataset", "method", "cameras")})) for trial in trials]
    spanned: dict[str, dict[str, None]] = {}
    for group, name in (("dataset", "dataset.name"), ("method", "method.name"), ("cameras", "cameras.source")):
        seen: dict[tuple[Any, str], Any] = {}
        for settings in plain:
            for path in (path for path in settings if path.startswith(f"{group}.") and path not in ROWS):
                if str(seen.setdefault((settings[name], path), settings[path])) != str(settings[path]):
                    spanned.setdefault(group, {})[path] = None
    paths = [path for found in spanned.values() for path in found]
    columns: dict[str, Method] = {}
    for settings in plain:
        where = {path: settings[path] for path in paths if path in settings}
        words = ", ".join(f"{path.partition('.')[2]} {one_line(str(value))}" for path, value in where.items())
        name = settings["method.name"]
        label = f"{method_label(name)}, {words}" if words else ""
        column = Method(name, where=where, label=label)
        columns.setdefault(column.key, column)
    return Layout("This sweep", "Every scene and method that it spans.", tuple(columns.values()))


def _flat(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted settings and their values."""
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
