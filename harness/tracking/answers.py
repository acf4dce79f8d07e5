"""What an experiment asks, and the runs in the tracker that answer it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import Request
from nrsfm.harness.record.folder import read_record
from nrsfm.harness.record.tracked import Answer, Tracked
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.tracking.tracker import Tracker
from nrsfm.harness.trial.execute import identify


class Store:
    """The runs that a tracker holds, read once.

    Parameters
    ----------
    settings : Settings
        Name the tracker.

    Raises
    ------
    UsageError
        If the tracker cannot be reached.
    """

    def __init__(self, settings: Settings) -> None:
        self.runs = Tracker(settings.tracking_uri, settings.output).outcomes()  # oldest first
        self._by_key: dict[str, Tracked] = {}
        self._by_setting: dict[str, Tracked] = {}
        for run in self.runs:
            self._by_key[run.outcome.key] = run
            held = self._by_setting.get(run.outcome.setting)
            if held is None or held.outcome.stand_in or not run.outcome.stand_in:
                self._by_setting[run.outcome.setting] = run

    def find(self, key: str, setting: str) -> Tracked | None:
        """The run of exactly this trial; else, as on a machine without the data, the newest of the same setting, one
        on real data before one on stand-ins."""
        return self._by_key.get(key) or self._by_setting.get(setting)


def answers(request: Request | Sequence[str], store: Store | None = None) -> tuple[list[Answer], Settings, Store]:
    """Every trial of the overrides with the run that answers it, None where none does.

    Parameters
    ----------
    request : Request or sequence of str
        The overrides, expanded or not.
    store : Store, optional
        The runs, where they have been read before; otherwise they are read now.

    Raises
    ------
    UsageError
        If the overrides cannot be composed or the tracker cannot be reached.
    """
    if not isinstance(request, Request):
        request = Request.of(request)
    trials, settings = request.trials, request.settings
    store = store or Store(settings)
    found: list[Answer] = [(trial, store.find(identify(trial, own)[0], trial.setting)) for trial, own in trials]
    return found, settings, store


def recorded(trials: Iterable[tuple[Trial, Settings]]) -> list[Answer]:
    """As :func:`answers` of trials, from the records in the output folder, which asks no tracker."""
    found: list[Answer] = []
    for trial, settings in trials:
        outcome = read_record(settings.trials / identify(trial, settings)[0])
        found.append((trial, None if outcome is None else Tracked(outcome, "", "")))
    return found
