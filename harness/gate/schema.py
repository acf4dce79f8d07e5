"""The fields of a baseline file, each checked, as anyone may have written the file; the first wrong one is named."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path
from typing import Annotated, Any, NoReturn

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.outcome import OK, STATUSES, Count
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.untrusted import first_error

SCHEMA = 2
LARGEST_FILE = 4 << 20  # bytes
LARGEST_REASON = 2000  # characters
REMEDY = "restore the file, or write it anew with 'nrsfm bless'"


def is_date(text: str) -> bool:
    """Whether a text is a day in the form YYYY-MM-DD."""
    try:
        return date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False


def _require(holds: object, message: str) -> None:
    if not holds:
        raise ValueError(message)


def _printable(text: str) -> str:
    _require(text.isprintable(), "wanted text without control characters")
    return text


def _filled(text: str) -> str:
    _require(text.strip(), "must not be empty")
    return text


def _day(text: str) -> str:
    _require(is_date(text), "wanted YYYY-MM-DD")
    return text


def _status(text: str) -> str:
    _require(text in STATUSES, f"wanted one of {', '.join(STATUSES)}")
    return text


def _version(version: int) -> int:
    _require(version == SCHEMA, f"this version reads {SCHEMA}; bless anew")
    return version


Word = Annotated[str, Field(max_length=200), AfterValidator(_printable)]
Name = Annotated[Word, AfterValidator(_filled)]
Reason = Annotated[str, Field(max_length=LARGEST_REASON), AfterValidator(_printable), AfterValidator(_filled)]
Day = Annotated[str, AfterValidator(_day)]
Number = Annotated[float, Field(ge=0)]


class _Checked(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


class Cell(_Checked):
    """One metric of one row; a row that did not finish has one cell without a number."""

    dataset: Name
    method: Name
    cameras: Name
    placement: Word
    motion: Word
    level: Number
    gaps: Name = ""
    stand_in: bool
    status: Annotated[str, AfterValidator(_status)]
    n_points: Count | None = None
    metric: Annotated[str | None, Field(max_length=60, validate_default=True)] = None
    value: Annotated[Number | None, Field(validate_default=True)] = None
    spread: Annotated[Number | None, Field(validate_default=True)] = None
    trials: list[Name]
    count: Count

    @field_validator("metric")
    @classmethod
    def _finished_rows_have_metrics(cls, metric: str | None, info: ValidationInfo) -> str | None:
        status = info.data.get("status")
        _require(status is None or (metric is not None) == (status == OK), f"the status is {status}")
        _require(metric is None or metric.isidentifier(), "wanted a metric's name")
        return metric

    @field_validator("value", "spread")
    @classmethod
    def _metrics_have_numbers(cls, number: float | None, info: ValidationInfo) -> float | None:
        if "metric" in info.data:
            metric, points = info.data["metric"], info.data.get("n_points")
            _require((number is None) == (metric is None), f"the metric is {metric}")
            if info.field_name == "value" and metric == "n_wrong" and points is not None:
                _require((number or 0) <= points, f"the scene has {points} tracks")
        return number

    @field_validator("count")
    @classmethod
    def _counts_the_trials(cls, count: int, info: ValidationInfo) -> int:
        _require(count == len(info.data.get("trials", range(count))), "wanted the number of trials")
        return count


class Blessing(_Checked):
    """An earlier reason."""

    date: Day
    reason: Reason


class BaselineFile(_Checked):
    """The whole file."""

    version: Annotated[int, Field(alias="schema"), AfterValidator(_version)]
    reason: Reason
    date: Day
    rows: Annotated[list[Cell], Field(min_length=1)]
    history: list[Blessing] = []


def parse(path: Path, text: str | bytes) -> BaselineFile:
    """The checked contents of the text of a file.

    Raises UsageError, naming the file and the field, if it is not strict JSON (a name twice, NaN) or not a baseline.
    """
    try:
        data = json.loads(text, object_pairs_hook=_unique, parse_constant=_no_number)
        return BaselineFile.model_validate(data)
    except ValidationError as error:
        raise UsageError(f"{path}: {first_error(error)}; {REMEDY}") from None
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is not valid JSON: {one_line(error)}") from None


def _unique(items: list[tuple[str, Any]]) -> dict[str, Any]:
    _require(len(dict(items)) == len(items), "a name is twice in one object")
    return dict(items)


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number")
