"""What an experiment asks, and the runs in the tracker that answer it."""

from __future__ import annotations

from collections.abc import Sequence

from harness.experiments import Settings, expand
from harness.tracking import Tracked, Tracker
from harness.trial import identify
from reports.tables import Answer


def answers(overrides: Sequence[str]) -> tuple[list[Answer], Settings]:
    """Every trial of the overrides with the run that answers it, None where none does.

    The run of exactly this trial (setting, data, method version) comes first. Where there is none, as on a machine
    without the data, the newest run of the same setting answers, one on real data before one on stand-ins.

    Raises
    ------
    UsageError
        If the overrides cannot be composed or the tracker cannot be reached.
    """
    trials = expand(overrides)
    settings = trials[0][1]
    by_key: dict[str, Tracked] = {}
    by_setting: dict[str, Tracked] = {}
    for run in Tracker(settings.tracking_uri, settings.output).outcomes():  # oldest first
        by_key[run.outcome.key] = run
        held = by_setting.get(run.outcome.setting)
        if held is None or held.outcome.stand_in or not run.outcome.stand_in:
            by_setting[run.outcome.setting] = run
    found: list[Answer] = []
    for trial, own in trials:
        key, _ = identify(trial, own)
        found.append((trial, by_key.get(key) or by_setting.get(trial.setting)))
    return found, settings
