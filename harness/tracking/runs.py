"""The trials of an experiment, and the records that answer them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import Request
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.record.tracked import Answer, Tracked
from nrsfm.harness.tracking.tracker import Tracker
from nrsfm.harness.trial.identity import identify


class Runs:
    """Records of trials, found by trial.

    Parameters
    ----------
    runs : sequence of Tracked
        Oldest first.
    """

    def __init__(self, runs: Sequence[Tracked]) -> None:
        self.runs = runs
        self._by_key: dict[str, Tracked] = {}
        self._by_setting: dict[str, Tracked] = {}
        for run in runs:
            self._by_key[run.outcome.key] = run
            other = self._by_setting.get(run.outcome.setting)
            if other is None or other.outcome.stand_in or not run.outcome.stand_in:
                self._by_setting[run.outcome.setting] = run

    @classmethod
    def of_tracker(cls, settings: Settings) -> Runs:
        """Every run of a tracker; raises UsageError if it cannot be reached."""
        return cls(Tracker(settings.tracking_uri, settings.output).outcomes())

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
    """Each trial of a request with the run that answers it, or None; and the runs.

    Parameters
    ----------
    request : Request
    runs : Runs, optional
        By default the tracker's, which are read.

    Raises
    ------
    UsageError
        If the tracker cannot be reached.
    """
    runs = runs or Runs.of_tracker(request.settings)
    return [(trial, runs.find(identify(trial, own).key, trial.setting)) for trial, own in request.trials], runs
