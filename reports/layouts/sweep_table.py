"""The layout of a sweep that belongs to no table: a column for each combination of the methods' settings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nrsfm.harness.record.parameters import flatten
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.trial import Trial, differing_keys
from nrsfm.reports.layouts.labels import method_label
from nrsfm.reports.layouts.layout import Layout, Method


def span(trials: Sequence[Trial]) -> Layout:
    """A layout with a column for each method and each combination of settings that its trials differ in.

    What the scenes differ in is told by the rows.
    """
    plain = [flatten({"method": t.method, "cameras": t.cameras}) for t in trials]
    spanned: dict[str, None] = {}
    for group, name in (("method", "method.name"), ("cameras", "cameras.source")):
        alike: dict[Any, list[dict[str, Any]]] = {}
        for settings in plain:
            own = {path: value for path, value in settings.items() if path.startswith(f"{group}.")}
            alike.setdefault(settings[name], []).append(own)
        spanned |= dict.fromkeys(path for each in alike.values() for path in differing_keys(each))
    columns: dict[str, Method] = {}
    for settings in plain:
        where = {path: settings[path] for path in spanned if path in settings}
        words = ", ".join(f"{path.partition('.')[2]} {one_line(str(value))}" for path, value in where.items())
        name = settings["method.name"]
        label = f"{method_label(name)}, {words}" if words else ""
        column = Method(name, where=where, label=label)
        columns.setdefault(column.key, column)
    return Layout("This sweep", "Every scene and method that it spans.", tuple(columns.values()))
