"""Arrays of runs, from the trial folders or from the artifacts in the tracker."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.folder import ARRAYS, read_arrays
from nrsfm.harness.record.outcome import OK
from nrsfm.harness.record.tracked import Tracked
from nrsfm.harness.tracking.tracker import Tracker


class Arrays:
    """Reads the arrays of runs: from the trial's folder, or from the tracker's artifacts if the folder is not here.

    Parameters
    ----------
    settings : Settings
    """

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
