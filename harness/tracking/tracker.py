"""Trial records in MLflow, and back. The records in the trial folders are the truth; the tracker can be rebuilt."""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filelock import FileLock

from nrsfm.harness.config import address
from nrsfm.harness.record.curves import thinned
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import (
    ARRAYS,
    LOG,
    RESULT,
    TRACEBACK,
    TRACKED,
    read_arrays,
    read_record,
    write_atomically,
)
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.parameters import flatten
from nrsfm.harness.record.tracked import Tracked
from nrsfm.harness.tracking import store

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Run


EXPERIMENT = "nrsfm"


LONGEST = 8000  # characters of a tag


os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")


os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")  # asked again unseen, a server makes a run twice


os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "20")


os.environ.setdefault("MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT", "true")


os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")


class Tracker:
    """One MLflow store.

    Parameters
    ----------
    uri : str
        ``sqlite:///...`` or the address of an MLflow server, which may hold a login; the attribute ``uri`` does not.
    output : Path
        Root of everything written; holds the lock files and, for SQLite, the artifacts.

    Raises
    ------
    UsageError
        By every method that uses the store, if that cannot be reached or does not do as it is told.
    """

    def __init__(self, uri: str, output: Path) -> None:
        self.uri, self._login = address.split(uri)
        self.output = output
        self._client: MlflowClient | None = None
        self._experiment = ""

    @property
    def client(self) -> MlflowClient:
        """The client, with the store created and the experiment there."""
        if self._client is None:
            self.output.mkdir(parents=True, exist_ok=True)
            with FileLock(self.output / ".tracker.lock"), self._in_words():
                self._client = self._connect()
        return self._client

    def _connect(self) -> MlflowClient:
        import logging

        from mlflow import MlflowClient

        for name in ("mlflow", "alembic", "sqlalchemy"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # their errors are raised as well
        os.environ.update(self._login)
        artifacts = None
        if self.uri.startswith("sqlite:///"):
            path = Path(self.uri.removeprefix("sqlite:///"))
            artifacts = (self.output / "artifacts").as_uri()
            if not path.exists():  # made beside its place: a kill in the middle leaves no half-made store
                fresh = path.with_name(f".{path.name}.new")
                fresh.unlink(missing_ok=True)
                MlflowClient(f"sqlite:///{fresh}").create_experiment(EXPERIMENT, artifacts)
                fresh.replace(path)
            with closing(sqlite3.connect(path)) as db:
                db.execute("PRAGMA journal_mode=WAL")
        client = MlflowClient(self.uri, registry_uri=self.uri)
        experiment = client.get_experiment_by_name(EXPERIMENT)
        self._experiment = experiment.experiment_id if experiment else client.create_experiment(EXPERIMENT, artifacts)
        return client

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        """MLflow lets the errors of its database, drivers and network through: they become one line."""
        try:
            yield
        except UsageError:
            raise
        except Exception as error:
            if isinstance(error, OSError) and error.filename:  # a file of the output folder
                raise
            said = store.words(error) or address.words(error, self.uri)
            raise UsageError(f"tracker {self.uri} cannot be used: {said}") from None

    def log(self, outcome: Outcome, folder: Path) -> str:
        """Write one trial, once: a whole run of the same trial and time is left alone, any other is replaced.

        The tag ``finished`` is written last and makes a run whole, so a run that a kill cut short is written anew.

        Parameters
        ----------
        outcome : Outcome
        folder : Path
            The trial's folder, whose files become artifacts.

        Returns
        -------
        str
            The run's id.
        """
        from mlflow.entities import Metric, Param, RunStatus, RunTag
        from mlflow.store.artifact.artifact_repository_registry import get_artifact_repository

        client, curves = self.client, _curves(folder)  # what is wrong with the folder is no fault of the tracker
        with FileLock(self.output / ".tracker.lock"), self._in_words():
            for run in client.search_runs([self._experiment], f"tags.trial_key = '{outcome.key}'"):
                if run.data.tags.get("finished") == outcome.finished:
                    self._note(outcome, folder)
                    return str(run.info.run_id)
                client.delete_run(run.info.run_id)
            end = int(datetime.fromisoformat(outcome.finished).timestamp() * 1000)
            start = end - int((outcome.seconds or 0) * 1000)
            run = client.create_run(
                self._experiment, start_time=start, run_name=f"{outcome.dataset} {outcome.method}", tags=_tags(outcome)
            )
            run_id = str(run.info.run_id)
            measured = {name: getattr(outcome, name) for name in ("seconds", "cpu_seconds", "peak_mb")}
            metrics = outcome.metrics | {name: value for name, value in measured.items() if value is not None}
            points = [Metric(name, value, end, 0) for name, value in metrics.items()]
            points += [Metric(name, value, end, step) for name, step, value in curves]
            place = get_artifact_repository(run.info.artifact_uri, tracking_uri=self.uri)
            for name in (RESULT, ARRAYS, TRACEBACK, LOG):
                if (folder / name).is_file() and (folder / name).stat().st_size:
                    place.log_artifact(str(folder / name))
            status = RunStatus.FINISHED if outcome.status == OK else RunStatus.FAILED
            client.set_terminated(run_id, RunStatus.to_string(status), end)
            client.log_batch(
                run_id,
                metrics=points[:1000],
                params=[Param(k, _clean(str(v))) for k, v in flatten(outcome.parameters).items()],
                tags=[RunTag(k, v) for k, v in (_pieces(outcome) | {"finished": outcome.finished}).items()],
            )
            self._note(outcome, folder)
        return run_id

    def holds(self, outcome: Outcome, folder: Path) -> bool:
        """Whether the trial's folder says that this store has the record; asks no store and loads no MLflow."""
        if self.uri.startswith("sqlite:///") and not Path(self.uri.removeprefix("sqlite:///")).is_file():
            return False
        try:
            return (folder / TRACKED).read_bytes() == self._mark(outcome)
        except OSError:
            return False

    def _note(self, outcome: Outcome, folder: Path) -> None:
        write_atomically(folder / TRACKED, lambda handle: handle.write(self._mark(outcome)))

    def _mark(self, outcome: Outcome) -> bytes:
        """Names the record and the store; a file that took the place of a lost SQLite store is another store."""
        store = Path(self.uri.removeprefix("sqlite:///"))
        identity = store.stat().st_ino if self.uri.startswith("sqlite:///") else ""
        return f"{outcome.finished} {self.uri} {identity}\n".encode()

    def outcomes(self, keys: Iterable[str] | None = None) -> list[Tracked]:
        """Every trial in the store, or those of some keys, oldest first."""
        wanted = [""] if keys is None else [f"tags.trial_key = '{key}'" for key in keys]
        found: list[Tracked] = []
        with self._in_words():
            runs = list(chain.from_iterable(map(self._runs, wanted)))
        for run in runs:
            try:
                outcome = Outcome.from_json(_record(run.data.tags))
            except ValueError:
                continue
            if run.data.tags.get("finished") != outcome.finished:  # cut short
                continue
            found.append(Tracked(outcome, str(run.info.run_id), self.uri))
        return sorted(found, key=lambda t: (t.outcome.finished, t.outcome.key))

    def fetch(self, run_id: str, name: str, folder: Path) -> bool:
        """Download a run's artifact into a folder; False if the store has none of that name."""
        if not re.fullmatch(r"[\w-]{1,64}", run_id, re.ASCII):  # it names a folder
            raise UsageError(f"tracker {self.uri}: {run_id[:80]!a} is no run's id")
        with self._in_words():
            if name not in {artifact.path for artifact in self.client.list_artifacts(run_id)}:
                return False
            folder.mkdir(parents=True, exist_ok=True)
            self.client.download_artifacts(run_id, name, str(folder))
        return True

    def _runs(self, wanted: str) -> Iterator[Run]:
        from mlflow.entities import ViewType

        token = None
        while True:
            page = self.client.search_runs(
                [self._experiment], wanted, ViewType.ACTIVE_ONLY, 1000, ["attributes.start_time ASC"], token
            )
            yield from page
            token = page.token
            if not token:
                return

    def sync(self, trials: Path, keys: Iterable[str] | None = None) -> tuple[int, list[str]]:
        """Bring trial folders (all, or those named) into the tracker: the runs written, and what could not be.

        A folder whose record is damaged or another trial's, or that the tracker does not take, harms no other.
        """
        keys = None if keys is None else list(keys)
        held = {(t.outcome.key, t.outcome.finished) for t in self.outcomes(keys)}
        folders = [trials / key for key in keys] if keys is not None else sorted(trials.glob("*/"))
        written, trouble = 0, []
        for folder in folders:
            outcome = read_record(folder)
            if outcome is None:
                if (folder / RESULT).exists():
                    trouble.append(f"{folder / RESULT} is damaged or another trial's; remove the folder")
            elif (outcome.key, outcome.finished) not in held:
                try:
                    self.log(outcome, folder)
                    written += 1
                except UsageError:
                    raise
                except Exception as error:  # MLflow's, and of what stands in the folder
                    trouble.append(f"{folder}: {type(error).__name__}: {' '.join(str(error).split())[:300]}")
            elif not self.holds(outcome, folder):
                self._note(outcome, folder)
        return written, trouble


def _tags(outcome: Outcome) -> dict[str, str]:
    names = ("setting", "status", "sweep", "dataset", "method", "cameras", "placement", "motion", "level", "repeat")
    tags = {name: str(getattr(outcome, name)) for name in names}
    return tags | {
        "trial_key": outcome.key,
        "stand_in": str(outcome.stand_in).lower(),
        "folder": f"trials/{outcome.key}",
        "error": _clean(outcome.error[:500]),
        **{f"env.{name}": _clean(value[:500]) for name, value in outcome.environment.items()},
    }


def _clean(text: str) -> str:
    """A text that every database takes: PostgreSQL has no NUL, and nobody encodes half a surrogate pair."""
    return text.replace("\0", "\N{REPLACEMENT CHARACTER}").encode(errors="replace").decode()


def _pieces(outcome: Outcome) -> dict[str, str]:
    """The record as tags, whose length is limited."""
    text = outcome.to_json()
    return {f"record{i or ''}": text[at : at + LONGEST] for i, at in enumerate(range(0, len(text), LONGEST))}


def _record(tags: Mapping[str, str]) -> str:
    """What :func:`_pieces` took apart."""
    return "".join(tags.get(f"record{i or ''}", "") for i in range(len(tags)))


def _curves(folder: Path) -> list[tuple[str, int, float]]:
    """The thinned residual history as (name, step, value)."""
    if not (folder / ARRAYS).is_file():
        return []
    curves = thinned(read_arrays(folder / ARRAYS))
    return [
        (name, int(s), float(v)) for name, (steps, values) in curves.items() for s, v in zip(steps, values, strict=True)
    ]
