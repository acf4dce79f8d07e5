"""A trial's record as the fields of an MLflow run: tags, parameters and stepped metrics."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

from nrsfm.harness.record.curves import thinned
from nrsfm.harness.record.folder import ARRAYS, read_arrays
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.parameters import flatten

if TYPE_CHECKING:
    from mlflow.entities import DatasetInput

LONGEST_KEY = 250  # characters

_TAGS = ("setting", "status", "sweep", "dataset", "method", "cameras", "placement", "motion", "level", "repeat")


def tags(outcome: Outcome) -> dict[str, str]:
    """Tags to search runs by: the trial, its setting and status, and its environment as ``env.NAME``."""
    return {name: str(getattr(outcome, name)) for name in _TAGS} | {
        "trial_key": outcome.key,
        "stand_in": str(outcome.stand_in).lower(),
        "folder": f"trials/{outcome.key}",
        "error": _storable(outcome.error[:500]),
        **_source(outcome),
        **{f"env.{name}": _storable(value[:500]) for name, value in outcome.environment.items()},
    }


def _source(outcome: Outcome) -> dict[str, str]:
    """What MLflow shows in the columns of source and version."""
    version = outcome.environment.get("commit", outcome.environment.get("nrsfm", ""))
    return {"mlflow.source.name": "nrsfm run", "mlflow.source.type": "LOCAL", "mlflow.source.git.commit": version}


def dataset(outcome: Outcome) -> DatasetInput:
    """The scene, as MLflow shows it in the column of datasets."""
    from mlflow.entities import Dataset, DatasetInput, InputTag

    digest = outcome.environment.get("data", "")[:36] or "?"
    kind = str(outcome.parameters.get("dataset", {}).get("source", ""))
    sizes = {"num_frames": outcome.n_frames, "num_tracks": outcome.n_points, "num_bodies": outcome.n_bodies}
    profile = json.dumps({name: size for name, size in sizes.items() if size is not None})
    stored = Dataset(outcome.dataset, digest, kind or "nrsfm", json.dumps({"source": kind}), profile=profile)
    return DatasetInput(stored, [InputTag("mlflow.data.context", "stand-in" if outcome.stand_in else "evaluation")])


def parameters(outcome: Outcome) -> dict[str, str]:
    """The trial's configuration by dotted name; signs that MLflow refuses in a name become ``_``."""
    flat = flatten(outcome.parameters).items()
    return {re.sub(r"[^\w. -]", "_", name)[:LONGEST_KEY]: _storable(str(value)) for name, value in flat}


def run_name(outcome: Outcome) -> str:
    """The name of a run: what its sweep called the trial."""
    return _storable(outcome.title[:250]) or f"{outcome.dataset} {outcome.method}"


def curve_points(folder: Path) -> list[tuple[str, int, float]]:
    """The thinned curves of a trial's iteration as (name, step, value); none if it has no arrays."""
    curves = thinned(read_arrays(folder / ARRAYS)).items() if (folder / ARRAYS).is_file() else ()
    return [(name, int(s), float(v)) for name, (steps, values) in curves for s, v in zip(steps, values, strict=True)]


def _storable(text: str) -> str:
    """Text that every database takes, without NUL (PostgreSQL) and half surrogate pairs (UTF-8)."""
    return text.replace("\0", "\N{REPLACEMENT CHARACTER}").encode(errors="replace").decode()
