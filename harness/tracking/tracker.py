"""Writes trials as runs of MLflow, and reads them. The store is a copy: 'nrsfm sync' rebuilds it from the records.

A store has one run of a trial, that of its latest record. Artifacts of a SQLite store stand beside its file, and it
does not say where that is, so that a folder of both can be moved, copied and mounted anywhere.
"""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock

from nrsfm.harness.config import address
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import (
    ARRAYS,
    LARGEST_RECORD,
    LOG,
    RESULT,
    TRACEBACK,
    TRACKED,
    read_record,
    write_atomically,
)
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.tracked import Tracked
from nrsfm.harness.record.untrusted import read_bounded
from nrsfm.harness.tracking.errors import explain
from nrsfm.harness.tracking.fresh_store import make_store
from nrsfm.harness.tracking.mlflow_fields import curve_points, dataset, parameters, run_name, tags

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Run
    from mlflow.store.artifact.artifact_repo import ArtifactRepository

EXPERIMENT = "nrsfm"

#: What MLflow shows of the experiment: its note, and the kind that decides which of the two halves opens.
ABOUT = {
    "mlflow.note.content": "A run is a trial: a method on a scene in a setting. `nrsfm report` makes the tables. The "
    "records in the folders `trials/` are the truth, and `nrsfm sync` brings them in.",
    "mlflow.experimentKind": "custom_model_development",
}
MOST_PARAMETERS = 100  # that MLflow takes at once

#: Where the artifacts of a SQLite store are, as the server that 'nrsfm ui' starts understands it: wherever it is told.
ARTIFACTS = "mlflow-artifacts:/"

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
        The output folder, which keeps what comes from a server.
    """

    def __init__(self, uri: str, output: Path) -> None:
        self.uri, self._login = address.split(uri)
        self.output = output
        self._file = address.file_of(self.uri)
        place = self._file.parent if self._file else output
        self._artifacts, self._lock = place / "artifacts", FileLock(place / ".tracker.lock")
        self._client: MlflowClient | None = None
        self._experiment = ""

    @property
    def client(self) -> MlflowClient:
        """MLflow's client; makes the store and the experiment if they are missing, restores a deleted experiment."""
        if self._client is None:
            Path(self._lock.lock_file).parent.mkdir(parents=True, exist_ok=True)
            with self._lock, self._explained():
                if self._file and not self._file.exists():
                    make_store(self._file)
                client = self._connect()
                experiment = client.get_experiment_by_name(EXPERIMENT)
                if experiment is None:
                    self._experiment = client.create_experiment(EXPERIMENT, ARTIFACTS if self._file else None, ABOUT)
                else:
                    self._experiment = experiment.experiment_id
                    if experiment.lifecycle_stage == "deleted":
                        client.restore_experiment(self._experiment)
                self._client = client
        return self._client

    @property
    def experiment(self) -> str:
        """The id of the experiment."""
        _ = self.client
        return self._experiment

    @property
    def served(self) -> list[str]:
        """The options with which MLflow's own server shows a SQLite store and its artifacts."""
        store = ["--backend-store-uri", address.for_mlflow(self.uri)]
        return [*store, "--artifacts-destination", self._artifacts.as_uri()]

    def deleted(self) -> bool:
        """Whether somebody has deleted the experiment; changes nothing."""
        with self._explained():
            experiment = self._connect().get_experiment_by_name(EXPERIMENT)
        return experiment is not None and experiment.lifecycle_stage == "deleted"

    def _connect(self) -> MlflowClient:
        import logging

        from mlflow import MlflowClient

        for name in ("mlflow", "alembic", "sqlalchemy"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # they log the errors that they raise
        os.environ.update(self._login)
        if self._file:
            with closing(sqlite3.connect(self._file)) as db:
                db.execute("PRAGMA journal_mode=WAL")
        uri = address.for_mlflow(self.uri)
        return MlflowClient(uri, registry_uri=uri)

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
        """Write a trial as a run, unless the store has a complete run of the same record or of a later one.

        The tag ``finished`` is written last. A run without it was cut short and is written anew. The files of the
        trial's folder become artifacts. Returns the id of the run that the store keeps.
        """
        from mlflow.entities import Metric, Param, RunStatus, RunTag

        client, curves = self.client, curve_points(folder)  # outside the tracker's errors: the folder may be damaged
        with self._lock, self._explained():
            for run in self._runs(outcome.key, deleted=True):
                finished = run.data.tags.get("finished", "")
                active = run.info.lifecycle_stage == "active"
                if finished == outcome.finished or (active and finished > outcome.finished):
                    if not active:
                        client.restore_run(run.info.run_id)
                    return self._mark_tracked(outcome, folder, run)
            end = int(datetime.fromisoformat(outcome.finished).timestamp() * 1000)
            start = end - int((outcome.seconds or 0) * 1000)
            run = client.create_run(self._experiment, start_time=start, run_name=run_name(outcome), tags=tags(outcome))
            run_id = str(run.info.run_id)
            measured = {name: getattr(outcome, name) for name in ("seconds", "cpu_seconds", "peak_mb")}
            metrics = outcome.metrics | measured
            client.log_inputs(run_id, [dataset(outcome)])
            points = [Metric(name, value, end, 0) for name, value in metrics.items() if value is not None]
            points += [Metric(name, value, end, step) for name, step, value in curves]
            place = self._place_of(run)
            for name in (RESULT, ARRAYS, TRACEBACK, LOG):
                if (folder / name).is_file() and (folder / name).stat().st_size:
                    place.log_artifact(str(folder / name))
            status = RunStatus.FINISHED if outcome.status == OK else RunStatus.FAILED
            client.set_terminated(run_id, RunStatus.to_string(status), end)
            params = [Param(k, v) for k, v in parameters(outcome).items()]
            for i in range(0, len(params), MOST_PARAMETERS):
                client.log_batch(run_id, params=params[i : i + MOST_PARAMETERS])
            client.log_batch(run_id, points[:1000], tags=[RunTag("finished", outcome.finished)])
            runs = self._runs(outcome.key)  # another output folder may have written at the same time
            latest = max(runs, key=lambda run: (run.data.tags.get("finished", ""), run.info.run_id))
            for run in runs:
                if run is not latest:
                    client.delete_run(run.info.run_id)
            return self._mark_tracked(outcome, folder, latest)

    def _place_of(self, run: Run) -> ArtifactRepository:
        """Where the artifacts of a run are."""
        from mlflow.store.artifact.artifact_repository_registry import get_artifact_repository

        place = (self._artifacts / run.info.run_id / "artifacts").as_uri() if self._file else run.info.artifact_uri
        return get_artifact_repository(place, tracking_uri=address.for_mlflow(self.uri))

    def holds(self, outcome: Outcome, folder: Path) -> bool:
        """Whether a mark in the trial's folder says that this store has the record; does not import MLflow."""
        return bool(self.run_of(outcome, folder))

    def run_of(self, outcome: Outcome, folder: Path) -> str:
        """The run that holds a record by the mark in the trial's folder, "" for none; does not import MLflow."""
        try:
            mark, _, run_id = (folder / TRACKED).read_text().strip().rpartition(" ")
            return run_id if mark == self._mark(outcome) else ""
        except (OSError, ValueError):  # there is no mark, or no store
            return ""

    def _mark_tracked(self, outcome: Outcome, folder: Path, run: Run) -> str:
        run_id = str(run.info.run_id)
        mark = f"{self._mark(outcome)} {run_id}\n".encode()
        write_atomically(folder / TRACKED, lambda handle: handle.write(mark))
        return run_id

    def _mark(self, outcome: Outcome) -> str:
        """The record's time and the store; the inode tells a new SQLite file from a lost one of the same name."""
        inode = self._file.stat().st_ino if self._file else ""
        return f"{outcome.finished} {self.uri} {inode}"

    def outcomes(self, without: Collection[str] = ()) -> list[Tracked]:
        """Complete runs, oldest first, but for those of the trials ``without``; their records are artifacts."""
        tracked: list[Tracked] = []
        if self._file and not self._file.exists():
            return tracked
        _ = self.client
        with self._explained():
            runs = [run for run in self._runs() if run.data.tags.get("trial_key") not in without]
        for run in runs:
            path = self.artifact(str(run.info.run_id), RESULT)
            try:
                outcome = Outcome.from_json(read_bounded(path, LARGEST_RECORD)) if path else None
            except ValueError:
                continue
            if outcome is not None and run.data.tags.get("finished") == outcome.finished:  # otherwise cut short
                tracked.append(Tracked(outcome, str(run.info.run_id), self.uri))
        return sorted(tracked, key=lambda t: (t.outcome.finished, t.outcome.key))

    def artifact(self, run_id: str, name: str) -> Path | None:
        """A file of a run, downloaded from a server once; None if the run has none of that name."""
        if not re.fullmatch(r"[\w-]{1,64}", run_id, re.ASCII):  # it becomes a folder's name
            raise UsageError(f"tracker {self.uri}: {run_id[:80]!a} is not a run's id")
        folder = self._artifacts / run_id / "artifacts" if self._file else self.output / "fetched" / run_id
        path = folder / name
        if not (self._file or path.is_file()):
            client = self.client
            with self._explained():
                if name not in {artifact.path for artifact in client.list_artifacts(run_id)}:
                    return None
                folder.mkdir(parents=True, exist_ok=True)
                client.download_artifacts(run_id, name, str(folder))
        return path if path.is_file() else None

    def _runs(self, key: str = "", deleted: bool = False) -> list[Run]:
        """The runs of a trial, or all, oldest first; with the deleted ones if asked."""
        from mlflow.entities import ViewType

        runs: list[Run] = []
        of_trial, view = f"tags.trial_key = '{key}'" if key else "", ViewType.ALL if deleted else ViewType.ACTIVE_ONLY
        token = None
        while token != "":
            page = self.client.search_runs(
                [self._experiment], of_trial, view, 1000, ["attributes.start_time ASC"], page_token=token
            )
            runs += page
            token = page.token or ""
        return runs

    def sync(self, trials: Path) -> tuple[int, list[str]]:
        """Write all trial folders into the tracker; a damaged one does not stop the others.

        Returns the number of runs written, and a line for each folder that could not be written.
        """
        _ = self.client
        with self._explained():
            held = {run.data.tags.get("trial_key"): run for run in self._runs() if "finished" in run.data.tags}
        written, problems = 0, []
        for folder in sorted(trials.glob("*/")):
            outcome = read_record(folder)
            if outcome is None:
                if (folder / RESULT).exists():
                    problems.append(f"{folder / RESULT} is damaged or another trial's; remove the folder")
                continue
            run = held.get(outcome.key)
            if run is not None and run.data.tags["finished"] >= outcome.finished:
                if not self.holds(outcome, folder):
                    self._mark_tracked(outcome, folder, run)
                continue
            try:
                self.log(outcome, folder)
                written += 1
            except UsageError:
                raise
            except Exception as error:  # a file in the folder is damaged
                problems.append(damage(folder, error))
        return written, problems
