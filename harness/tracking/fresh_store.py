"""Makes an empty SQLite store of MLflow. Its migrations take longer than a small trial, so the result is cached."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing, suppress
from importlib.metadata import version
from pathlib import Path
from secrets import token_hex

from nrsfm.harness.config.address import SQLITE, for_mlflow


def make_store(path: Path) -> None:
    """Make a store without experiments, under another name first: a kill leaves no half-made store."""
    from pooch import os_cache

    fresh, cached = path.with_name(f".{path.name}.new"), Path(os_cache("nrsfm")) / f"mlflow-{version('mlflow')}.db"
    try:
        shutil.copyfile(cached, fresh)
    except OSError:
        _migrate(fresh)
        with suppress(OSError):  # without a cache every store is migrated
            cached.parent.mkdir(parents=True, exist_ok=True)
            part = cached.with_name(f".{token_hex(4)}.db")
            shutil.copyfile(fresh, part)
            part.replace(cached)
    fresh.replace(path)


def _migrate(path: Path) -> None:
    """Have MLflow make a store, and remove its default experiment, which names this process's working folder."""
    from mlflow import MlflowClient

    path.unlink(missing_ok=True)
    MlflowClient(for_mlflow(f"{SQLITE}{path}")).search_experiments(max_results=1)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("DELETE FROM experiments")
