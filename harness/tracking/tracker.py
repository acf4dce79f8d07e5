"""Writes trials as runs of MLflow, and reads them. The store is a copy: 'nrsfm sync' rebuilds it from the records."""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock

from nrsfm.harness.config import address
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import ARRAYS, LOG, RESULT, TRACEBACK, TRACKED, read_record, write_atomically
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.tracked import Tracked
from nrsfm.harness.tracking.errors import explain
from nrsfm.harness.tracking.fresh_store import make_store
from nrsfm.harness.tracking.mlflow_fields import curve_points, parameters, record_tags, record_text, tags

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Run

EXPERIMENT = "nrsfm"

for _name, _value in {
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0",  # a repeated request can make a run twice
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "20",
    "MLFLOW_SQLALCHEMYSTORE_POOLCLASS": "NullPool",  # a kept connection would write into a file that was removed
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "GIT_PYTHON_REFRESH": "quiet",
}.items():
    os.environ.setdefault(_name, _value)


def damage(folder: Path, error: Exception) -> str:
    """A line about an error that the files of a trial's folder cause."""
    return f"{folder}: {type(error).__name__}: {' '.join(str(error).split())[:300]}"


class Tracker:
    """An MLflow store of trials; every method that uses it raises UsageError if it cannot be reached or has an error.

    Parameters
    ----------
    uri : str
        ``sqlite:///...`` or the address of an MLflow server, which may hold a login; the attribute ``uri`` does not.
    output : Path
        The output folder, with the lock file and, for SQLite, the artifacts.
    """

    def __init__(self, uri: str, output: Path) -> None:
        self.uri, self._login = address.split(uri)
        self.output = output
        self._file = Path(self.uri.removeprefix("sqlite:///")) if self.uri.startswith("sqlite:///") else None
        self._client: MlflowClient | None = None
        self._experiment = ""

    @property
    def client(self) -> MlflowClient:
        """MLflow's client; creates the store and the experiment if they are missing."""
        if self._client is None:
            self.output.mkdir(parents=True, exist_ok=True)
            with FileLock(self.output / ".tracker.lock"), self._explained():
                self._client = self._connect()
        return self._client

    def _connect(self) -> MlflowClient:
        import logging

        from mlflow import MlflowClient

        for name in ("mlflow", "alembic", "sqlalchemy"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # they log the errors that they raise
        os.environ.update(self._login)
        artifacts = None
        if path := self._file:
            artifacts = (self.output / "artifacts").as_uri()
            if not path.exists():
                make_store(path)
            with closing(sqlite3.connect(path)) as db:
                db.execute("PRAGMA journal_mode=WAL")
        client = MlflowClient(self.uri, registry_uri=self.uri)
        experiment = client.get_experiment_by_name(EXPERIMENT)
        self._experiment = experiment.experiment_id if experiment else client.create_experiment(EXPERIMENT, artifacts)
        return client

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn errors of MLflow, its database and its network into a UsageError of one line."""
        try:
            yield
        except UsageError:
            raise
        except Exception as error:
            if isinstance(error, OSError) and error.filename:  # a file of the output folder
                raise
            raise UsageError(f"tracker {self.uri} cannot be used: {explain(error, self.uri)}") from None

    def log(self, outcome: Outcome, folder: Path) -> str:
        """Write a trial as a run, unless the store has a complete run of the same trial and time; replace any other.

        The tag ``finished`` is written last. A run without it was cut short and is written anew. The files of the
        trial's folder become artifacts. Returns the id of the run.
        """
        from mlflow.entities import Metric, Param, RunStatus, RunTag
        from mlflow.store.artifact.artifact_repository_registry import get_artifact_repository

        client, curves = self.client, curve_points(folder)  # outside the tracker's errors: the folder may be damaged
        with FileLock(self.output / ".tracker.lock"), self._explained():
            for run in client.search_runs([self._experiment], f"tags.trial_key = '{outcome.key}'"):
                if run.data.tags.get("finished") == outcome.finished:
                    self._mark_tracked(outcome, folder)
                    return str(run.info.run_id)
                client.delete_run(run.info.run_id)
            end = int(datetime.fromisoformat(outcome.finished).timestamp() * 1000)
            start = end - int((outcome.seconds or 0) * 1000)
            name = f"{outcome.dataset} {outcome.method}"
            run = client.create_run(self._experiment, start_time=start, run_name=name, tags=tags(outcome))
            run_id = str(run.info.run_id)
            measured = {name: getattr(outcome, name) for name in ("seconds", "cpu_seconds", "peak_mb")}
            metrics = outcome.metrics | measured
            points = [Metric(name, value, end, 0) for name, value in metrics.items() if value is not None]
            points += [Metric(name, value, end, step) for name, step, value in curves]
            place = get_artifact_repository(run.info.artifact_uri, tracking_uri=self.uri)
            for name in (RESULT, ARRAYS, TRACEBACK, LOG):
                if (folder / name).is_file() and (folder / name).stat().st_size:
                    place.log_artifact(str(folder / name))
            status = RunStatus.FINISHED if outcome.status == OK else RunStatus.FAILED
            client.set_terminated(run_id, RunStatus.to_string(status), end)
            params = [Param(k, v) for k, v in parameters(outcome).items()]
            last = [RunTag(k, v) for k, v in (record_tags(outcome) | {"finished": outcome.finished}).items()]
            client.log_batch(run_id, points[:1000], params, last)
            self._mark_tracked(outcome, folder)
        return run_id

    def holds(self, outcome: Outcome, folder: Path) -> bool:
        """Whether a mark in the trial's folder says that this store has the record; does not import MLflow."""
        try:
            return (folder / TRACKED).read_bytes() == self._mark(outcome)
        except OSError:  # there is no mark, or no store
            return False

    def _mark_tracked(self, outcome: Outcome, folder: Path) -> None:
        write_atomically(folder / TRACKED, lambda handle: handle.write(self._mark(outcome)))

    def _mark(self, outcome: Outcome) -> bytes:
        """The record's time and the store; the inode tells a new SQLite file from a lost one of the same name."""
        inode = self._file.stat().st_ino if self._file else ""
        return f"{outcome.finished} {self.uri} {inode}\n".encode()

    def outcomes(self) -> list[Tracked]:
        """Complete runs of all trials, oldest first."""
        tracked: list[Tracked] = []
        with self._explained():
            runs = list(self._runs())
        for run in runs:
            try:
                outcome = Outcome.from_json(record_text(run.data.tags))
            except ValueError:
                continue
            if run.data.tags.get("finished") == outcome.finished:  # otherwise cut short
                tracked.append(Tracked(outcome, str(run.info.run_id), self.uri))
        return sorted(tracked, key=lambda t: (t.outcome.finished, t.outcome.key))

    def fetch(self, run_id: str, name: str, folder: Path) -> bool:
        """Download an artifact of a run into a folder; False if the run has no artifact of that name."""
        if not re.fullmatch(r"[\w-]{1,64}", run_id, re.ASCII):  # it becomes a folder's name
            raise UsageError(f"tracker {self.uri}: {run_id[:80]!a} is not a run's id")
        with self._explained():
            if name not in {artifact.path for artifact in self.client.list_artifacts(run_id)}:
                return False
            folder.mkdir(parents=True, exist_ok=True)
            self.client.download_artifacts(run_id, name, str(folder))
        return True

    def _runs(self) -> Iterator[Run]:
        """All runs, page by page."""
        token = None
        while token != "":
            page = self.client.search_runs(
                [self._experiment], max_results=1000, order_by=["attributes.start_time ASC"], page_token=token
            )
            yield from page
            token = page.token or ""

    def sync(self, trials: Path) -> tuple[int, list[str]]:
        """Write all trial folders into the tracker; a damaged one does not stop the others.

        Returns the number of runs written, and a line for each folder that could not be written.
        """
        tracked = {(t.outcome.key, t.outcome.finished) for t in self.outcomes()}
        written, problems = 0, []
        for folder in sorted(trials.glob("*/")):
            outcome = read_record(folder)
            if outcome is None:
                if (folder / RESULT).exists():
                    problems.append(f"{folder / RESULT} is damaged or another trial's; remove the folder")
            elif (outcome.key, outcome.finished) not in tracked:
                try:
                    self.log(outcome, folder)
                    written += 1
                except UsageError:
                    raise
                except Exception as error:  # a file in the folder is damaged
                    problems.append(damage(folder, error))
            elif not self.holds(outcome, folder):
                self._mark_tracked(outcome, folder)
        return written, problems
