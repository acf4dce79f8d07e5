"""Finished trials as a pandas DataFrame."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from nrsfm.harness.config.spans import expand
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.tracking.trial_runs import Runs
from nrsfm.harness.trial.identity import identify

MISSING = "missing"
"""Status of a trial that has not run."""

COUNTS = ("n_bodies", "n_points", "n_frames")
BEFORE = ("dataset", "method", "cameras", "placement", "motion", "level", "gaps", "repeat", "stand_in", *COUNTS)
AFTER = ("seconds", "cpu_seconds", "peak_mb", "status", "error", "sweep", "finished", "key")


def results(output: str | Path | None = None, experiment: str | None = None) -> pd.DataFrame:
    """Finished trials as a table, one row a trial, read from the records in an output folder.

    Parameters
    ----------
    output : str or Path, optional
        The folder that ``nrsfm run`` wrote to: by default ``NRSFM_OUTPUT``, or ``outputs``.
    experiment : str, optional
        Restricts the table to the trials of an experiment such as ``table1``, in its order; those that have not run
        have status ``missing``. By default all trials, in the order in which they ended.

    Returns
    -------
    DataFrame
        The columns of :data:`BEFORE`; one for each metric, NaN where it does not apply; and those of :data:`AFTER`.
        ``finished`` is a time in UTC.

    Raises
    ------
    UsageError
        If the folder holds no trials, or there is no such experiment.

    Examples
    --------
    ::

        trials = results(experiment="table1")
        trials[~trials.stand_in].groupby(["dataset", "method"]).e_ms.mean().unstack()
    """
    folder = Path(output or os.environ.get("NRSFM_OUTPUT") or "outputs") / "trials"
    if not folder.is_dir():
        raise UsageError(f"{folder} is missing; name the folder that 'nrsfm run' wrote to: results('outputs')")
    runs = Runs.of_folder(folder)
    if experiment is None:
        return _frame([(run.outcome, run.outcome.status) for run in runs.runs])
    rows = []
    for trial, settings in expand([f"experiment={experiment}"]):
        key = identify(trial, settings).key
        run = runs.find(key, trial.setting)
        rows.append((run.outcome, run.outcome.status) if run else (Outcome.of_trial(trial, key), MISSING))
    return _frame(rows)


def _frame(rows: Sequence[tuple[Outcome, str]]) -> pd.DataFrame:
    metrics = list(dict.fromkeys(name for outcome, _ in rows for name in outcome.metrics))
    columns = [*BEFORE, *metrics, *AFTER]
    fields = ({name: getattr(outcome, name) for name in (*BEFORE, *AFTER)} | outcome.metrics for outcome, _ in rows)
    frame = pd.DataFrame(fields, columns=columns).assign(status=[status for _, status in rows])
    numbers = ["level", *metrics, "seconds", "cpu_seconds", "peak_mb"]
    frame = frame.astype(dict.fromkeys(numbers, "float64") | dict.fromkeys(COUNTS, "Int64"))
    return frame.assign(finished=pd.to_datetime(frame.finished, utc=True, format="ISO8601"))
