"""What reports read besides the tables' answers: the arrays of a run, and the runs that claims are judged by."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from harness.experiments import Settings, read_plain
from harness.jobs import plain_jobs
from harness.record import OK
from harness.storage import ARRAYS, read_arrays
from harness.tracking import Tracked, Tracker
from reports.grid import scene_words


class Arrays:
    """Gives the arrays of runs: from the trial's folder, or where that is elsewhere from the tracker's artifacts.

    Parameters
    ----------
    settings : Settings
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._tracker = Tracker(settings.tracking_uri, settings.output)
        self._read = lru_cache(maxsize=256)(self._load)

    def __call__(self, run: Any) -> dict[str, Any]:
        """The arrays of a tracked run by name, empty if it left none."""
        return self._read(run.outcome.key, run.run_id) if run.outcome.status == OK else {}

    def _load(self, key: str, run_id: str) -> dict[str, Any]:
        path = self._settings.trials / key / ARRAYS
        if not path.is_file():
            path = self._settings.output / "fetched" / run_id / ARRAYS
            if not path.is_file() and not self._tracker.fetch(run_id, ARRAYS, path.parent):
                return {}
        return read_arrays(path)


def as_configured(runs: Iterable[Tracked], methods: Iterable[str]) -> list[Tracked]:
    """Finished runs on the published scenes, on real data, of methods with the settings of ``conf/method``."""
    jobs = plain_jobs([f"method={name}"] for name in methods)
    wanted = {str(trial.method["name"]): trial.method for trial, _ in map(read_plain, jobs)}
    return [
        run
        for run in runs
        if run.outcome.status == OK
        and not run.outcome.stand_in
        and run.outcome.parameters.get("method") == wanted.get(run.outcome.method)
        and not run.outcome.parameters.get("gaps")
        and not scene_words(run.outcome.parameters.get("dataset", {}))
    ]
