"""Finds the finished run of each trial of an experiment, and the arrays that it left."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import Request
from nrsfm.harness.record.folder import ARRAYS, read_arrays, read_record
from nrsfm.harness.record.outcome import OK
from nrsfm.harness.record.tracked import Answer, Tracked
from nrsfm.harness.tracking.tracker import Tracker
from nrsfm.harness.trial.identity import identify


class Runs:
    """Records of trials, oldest first, found by trial."""

    def __init__(self, runs: Sequence[Tracked]) -> None:
        self.runs = runs
        self._by_key = {run.outcome.key: run for run in runs}
        by_preference = sorted(runs, key=lambda run: not run.outcome.stand_in)  # the last one of a setting counts
        self._by_setting = {run.outcome.setting: run for run in by_preference}

    @classmethod
    def of_folder(cls, trials: Path) -> Runs:
        """Every record in a folder of trials; damaged ones are left out."""
        outcomes = [outcome for folder in trials.glob("*/") if (outcome := read_record(folder)) is not None]
        outcomes.sort(key=lambda outcome: (outcome.finished, outcome.key))
        return cls([Tracked(outcome, "", "") for outcome in outcomes])

    def find(self, key: str, setting: str) -> Tracked | None:
        """The run of a trial, or None.

        Where there is none of its key, as on a machine without the data: the newest of its setting, one on real data
        before one on stand-ins.
        """
        return self._by_key.get(key) or self._by_setting.get(setting)


def answers(request: Request, runs: Runs | None = None) -> tuple[list[Answer], Runs]:
    """Each trial of a request with the run that answers it, or None; and the runs, by default all of the tracker's.

    Raises UsageError if the tracker cannot be reached.
    """
    runs = runs or Runs(Tracker(request.settings.tracking_uri, request.settings.output).outcomes())
    return [(trial, runs.find(identify(trial, own).key, trial.setting)) for trial, own in request.trials], runs


class Arrays:
    """Reads the arrays of runs: from the trial's folder, or from the tracker's artifacts if the folder is not here."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._tracker = Tracker(settings.tracking_uri, settings.output)
        self._read = lru_cache(maxsize=256)(self._load)

    def __call__(self, run: Tracked) -> dict[str, Any]:
        """The arrays of a run by name; empty if it has none."""
        return self._read(run.outcome.key, run.run_id) if run.outcome.status == OK else {}

    def _load(self, key: str, run_id: str) -> dict[str, Any]:
        path = self._settings.trials / key / ARRAYS
        if not path.is_file():
            path = self._settings.output / "fetched" / run_id / ARRAYS
            if not path.is_file() and not self._tracker.fetch(run_id, ARRAYS, path.parent):
                return {}
        return read_arrays(path)
