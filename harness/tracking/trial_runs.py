"""Finds the finished run of each trial of an experiment, and the arrays that it left."""

from __future__ import annotations

from collections.abc import Collection, Sequence
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
    """Records of trials, found by trial; ``complete`` with those that the tracker alone has."""

    def __init__(self, runs: Sequence[Tracked], complete: bool = False) -> None:
        self.runs = sorted(runs, key=lambda run: (run.outcome.finished, run.outcome.key))
        self.complete = complete
        self._by_key = {run.outcome.key: run for run in self.runs}
        by_preference = sorted(self.runs, key=lambda run: not run.outcome.stand_in)  # the last one of a setting counts
        self._by_setting = {run.outcome.setting: run for run in by_preference}

    @classmethod
    def of_folder(cls, trials: Path, tracker: Tracker | None = None) -> Runs:
        """Every record in a folder of trials, with its run in the tracker if it has one; damaged ones are left out."""
        runs = []
        for folder in trials.glob("*/"):
            if (outcome := read_record(folder)) is not None:
                run_id = tracker.run_of(outcome, folder) if tracker else ""
                runs.append(Tracked(outcome, run_id, tracker.uri if tracker and run_id else ""))
        return cls(runs)

    @property
    def keys(self) -> Collection[str]:
        """The trials that have a run."""
        return self._by_key.keys()

    def find(self, key: str, setting: str) -> Tracked | None:
        """The run of a trial, or None.

        Where there is none of its key, as on a machine without the data: the newest of its setting, one on real data
        before one on stand-ins.
        """
        return self._by_key.get(key) or self._by_setting.get(setting)


def answers(request: Request, runs: Runs | None = None) -> tuple[list[Answer], Runs]:
    """Each trial of a request with the run that answers it, or None; and all runs that are known.

    The records in the output folder are the truth. Only if one is missing, the tracker, slow to load, is asked as well.
    Raises UsageError if it cannot be reached.

    Parameters
    ----------
    request : Request
    runs : Runs, optional
        Those of an earlier call for the same output folder.
    """
    settings = request.settings
    tracker = Tracker(settings.tracking_uri, settings.output)
    runs = runs or Runs.of_folder(settings.trials, tracker)
    asked = [(trial, identify(trial, own).key) for trial, own in request.trials]
    if any(key not in runs.keys for _, key in asked) and not runs.complete:
        more = tracker.outcomes(without=runs.keys)
        runs = Runs([*more, *runs.runs], complete=True)
    return [(trial, runs.find(key, trial.setting)) for trial, key in asked], runs


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
            artifact = self._tracker.artifact(run_id, ARRAYS) if run_id else None
            if artifact is None:
                return {}
            path = artifact
        return read_arrays(path)
