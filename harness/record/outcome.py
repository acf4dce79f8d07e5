from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from datetime import datetime
from typing import Any

from nrsfm.harness.record.trial import gap_words

OK, FAILED, CRASHED, TIMEOUT, OOM, ABSENT = STATUSES = ("ok", "failed", "crashed", "timeout", "oom", "absent")


@dataclass(frozen=True)
class Outcome:
    """What a trial left behind; the contents of its ``result.json``.

    ``metrics`` holds finite numbers alone: a metric that does not apply is left out, never null or 0.
    ``seconds`` is time by the clock, ``cpu_seconds`` that of all cores, ``peak_mb`` the largest resident size in MB.
    ``status`` is one of ok, failed (an exception), crashed (the process died), timeout, oom, absent (the data are not
    there; ``error`` says how to get them).
    """

    key: str
    setting: str
    status: str
    dataset: str
    method: str
    cameras: str
    placement: str
    motion: str
    level: float
    repeat: int
    stand_in: bool = False
    n_bodies: int | None = None
    n_points: int | None = None
    n_frames: int | None = None
    metrics: dict[str, float] = field(default_factory=dict)
    seconds: float | None = None
    cpu_seconds: float | None = None
    peak_mb: float | None = None
    error: str = ""
    finished: str = ""
    sweep: str = ""
    parameters: dict[str, Any] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.status not in STATUSES:
            raise ValueError(f"status {self.status!r} is not one of {', '.join(STATUSES)}")
        odd = [k for k, v in self.metrics.items() if not math.isfinite(v)]
        if odd:
            raise ValueError(f"metrics must be finite, these are not: {', '.join(odd)}")

    @property
    def gaps(self) -> str:
        """``random 0.2``: the observations that were dropped; "" for none."""
        return gap_words(self.parameters.get("gaps", {}))

    @property
    def identity(self) -> tuple[Any, ...]:
        """What a reader calls the row, whatever the method's settings: names a baseline's row."""
        words = (self.dataset, self.method, self.cameras, self.placement, self.motion)
        return (*words, self.level, self.gaps, self.repeat)

    def to_json(self) -> str:
        """JSON with absent values left out."""
        return json.dumps({k: v for k, v in asdict(self).items() if v is not None}, indent=1) + "\n"

    @classmethod
    def from_json(cls, text: str) -> Outcome:
        """Read what :meth:`to_json` wrote; unknown fields of later versions are dropped.

        Raises
        ------
        ValueError
            If the text is not such a record.
        """
        try:
            data = json.loads(text)
        except RecursionError:
            raise ValueError("not a trial record: nested too deeply") from None
        if not isinstance(data, dict):
            raise ValueError("not a trial record")
        known = {f.name: data[f.name] for f in fields(cls) if f.name in data}
        for f in fields(cls):
            if f.name in known and not _FITS[f.type](known[f.name]):
                raise ValueError(f"not a trial record: {f.name} is no {f.type}")
        if not re.fullmatch(r"[\w-]{1,64}", str(known.get("key", "")), re.ASCII):
            raise ValueError("not a trial record: key is no trial's")
        if not _is_moment(known.get("finished", "")):
            raise ValueError("not a trial record: finished is no time")
        try:
            return cls(**known)
        except TypeError as error:
            raise ValueError(f"not a trial record: {error}") from None


def _is_number(value: Any) -> bool:
    """A finite number that nothing counted or measured here exceeds."""
    return type(value) in (int, float) and -1e100 < value < 1e100


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 <= value < 10**9


def _is_measured(value: Any) -> bool:
    return type(value) is dict and all(re.fullmatch(r"\w{1,60}", k) and _is_number(v) for k, v in value.items())


def _is_settings(value: Any) -> bool:
    """Parameters by group, whose gaps have a kind and a share."""
    if type(value) is not dict or not all(type(group) is dict for group in value.values()):
        return False
    gaps = value.get("gaps")
    return not gaps or (type(gaps.get("kind")) is str and _is_number(gaps.get("share")))


def _is_moment(text: str) -> bool:
    """A time with its zone, of this century, or none."""
    try:
        return not text or 2000 <= datetime.fromisoformat(text).astimezone().year < 2100
    except (ValueError, OverflowError):
        return False


#: What each type of a record's fields takes of what JSON may hold.
_FITS: Mapping[Any, Callable[[Any], bool]] = {
    "str": lambda value: type(value) is str,
    "bool": lambda value: type(value) is bool,
    "float": lambda value: _is_number(value) and value >= 0,
    "int": _is_count,
    "int | None": lambda value: value is None or _is_count(value),
    "float | None": lambda value: value is None or (_is_number(value) and 0 <= value < 1e9),
    "dict[str, float]": _is_measured,
    "dict[str, Any]": _is_settings,
    "dict[str, str]": lambda value: type(value) is dict and all(type(v) is str for v in value.values()),
}
