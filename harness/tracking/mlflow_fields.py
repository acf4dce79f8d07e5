"""A trial's record as the fields of an MLflow run: tags, parameters and stepped metrics."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from nrsfm.harness.record.curves import thinned
from nrsfm.harness.record.folder import ARRAYS, read_arrays
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.parameters import flatten

LONGEST_TAG = 8000  # characters

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
    """The trial's configuration by dotted name."""
    return {name: _storable(str(value)) for name, value in flatten(outcome.parameters).items()}


def record_tags(outcome: Outcome) -> dict[str, str]:
    """The whole record as JSON, in the tags ``record``, ``record1``, ... because the length of a tag is limited."""
    text = outcome.to_json()
    starts = range(0, len(text), LONGEST_TAG)
    return {f"record{i or ''}": text[start : start + LONGEST_TAG] for i, start in enumerate(starts)}


def record_text(tags: Mapping[str, str]) -> str:
    """The JSON that :func:`record_tags` split."""
    return "".join(tags.get(f"record{i or ''}", "") for i in range(len(tags)))


def curve_points(folder: Path) -> list[tuple[str, int, float]]:
    """The thinned curves of a trial's iteration as (name, step, value); none if it has no arrays."""
    curves = thinned(read_arrays(folder / ARRAYS)).items() if (folder / ARRAYS).is_file() else ()
    return [(name, int(s), float(v)) for name, (steps, values) in curves for s, v in zip(steps, values, strict=True)]


def _storable(text: str) -> str:
    """Text that every database takes, without NUL (PostgreSQL) and half surrogate pairs (UTF-8)."""
    return text.replace("\0", "\N{REPLACEMENT CHARACTER}").encode(errors="replace").decode()
