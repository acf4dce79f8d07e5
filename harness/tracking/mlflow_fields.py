"""A trial's record as the fields of an MLflow run: tags, parameters and stepped metrics."""

from __future__ import annotations

import re
from pathlib import Path

from nrsfm.harness.record.curves import thinned
from nrsfm.harness.record.folder import ARRAYS, read_arrays
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.parameters import flatten

LONGEST_KEY = 250  # characters

_TAGS = ("setting", "status", "sweep", "dataset", "method", "cameras", "placement", "motion", "level", "repeat")


def tags(outcome: Outcome) -> dict[str, str]:
    """Tags to search runs by: the trial, its setting and status, and its environment as ``env.NAME``."""
    return {name: str(getattr(outcome, name)) for name in _TAGS} | {
        "trial_key": outcome.key,
        "stand_in": str(outcome.stand_in).lower(),
        "folder": f"trials/{outcome.key}",
        "error": _storable(outcome.error[:500]),
        **{f"env.{name}": _storable(value[:500]) for name, value in outcome.environment.items()},
    }


def parameters(outcome: Outcome) -> dict[str, str]:
    """The trial's configuration by dotted name; signs that MLflow refuses in a name become ``_``."""
    flat = flatten(outcome.parameters).items()
    return {re.sub(r"[^\w. -]", "_", name)[:LONGEST_KEY]: _storable(str(value)) for name, value in flat}


def run_name(outcome: Outcome) -> str:
    """The name of a run."""
    return f"{outcome.dataset} {outcome.method}"


def curve_points(folder: Path) -> list[tuple[str, int, float]]:
    """The thinned curves of a trial's iteration as (name, step, value); none if it has no arrays."""
    curves = thinned(read_arrays(folder / ARRAYS)).items() if (folder / ARRAYS).is_file() else ()
    return [(name, int(s), float(v)) for name, (steps, values) in curves for s, v in zip(steps, values, strict=True)]


def _storable(text: str) -> str:
    """Text that every database takes, without NUL (PostgreSQL) and half surrogate pairs (UTF-8)."""
    return text.replace("\0", "\N{REPLACEMENT CHARACTER}").encode(errors="replace").decode()
