"""The record of a finished trial, and reading it back from a file that anyone may have written."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from annotated_types import Ge, Gt, Lt, Predicate

from nrsfm.harness.record.trial import GROUPS, Trial, corruption_words, gap_words, observation_words
from nrsfm.harness.record.untrusted import checked

if TYPE_CHECKING:
    from pydantic import ConfigDict

OK, FAILED, CRASHED, TIMEOUT, OOM, ABSENT = STATUSES = ("ok", "failed", "crashed", "timeout", "oom", "absent")


def _is_key(text: str) -> bool:
    return re.fullmatch(r"[\w-]{1,64}", text, re.ASCII) is not None


def _is_metric(text: str) -> bool:
    return re.fullmatch(r"\w{1,60}", text) is not None


def _is_time(text: str) -> bool:
    """Whether a text is empty or a time of this century, in ISO format."""
    try:
        return not text or 2000 <= datetime.fromisoformat(text).astimezone().year < 2100
    except (ValueError, OverflowError):
        return False


def _has_readable_gaps(parameters: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether gaps and corruption, where there are any, have the numbers that :attr:`Outcome.gaps` prints."""
    gaps = parameters.get("gaps") or {"kind": "", "share": 0}
    corruption = parameters.get("corruption", {})
    amounts = [gaps.get("share"), *(corruption.get(name, 0) for name in ("outliers", "jumps", "zoom"))]
    words = (gaps.get("kind"), corruption.get("zooming", ""))
    numbers = all(isinstance(amount, int | float) and abs(amount) < math.inf for amount in amounts)
    return numbers and all(isinstance(word, str) for word in words)


#: Types of a record's fields, with bounds that nothing counted or measured here exceeds.
Count = Annotated[int, Ge(0), Lt(10**9)]
Measured = Annotated[float, Ge(0), Lt(1e9)]
Metrics = dict[Annotated[str, Predicate(_is_metric)], Annotated[float, Gt(-1e100), Lt(1e100)]]
Parameters = Annotated[dict[str, dict[str, Any]], Predicate(_has_readable_gaps)]


@dataclass(frozen=True)
class Outcome:
    """The record of a trial: the contents of its ``result.json``.

    Parameters
    ----------
    key, setting : str
        Hashes of the trial, see :class:`nrsfm.harness.record.trial.Trial`.
    status : str
        ok, failed (an exception), crashed (the process died), timeout, oom (out of memory), or absent (the data are
        missing; ``error`` says how to get them).
    stand_in : bool
        Whether generated data took the place of a real sequence.
    metrics : dict
        Finite numbers; a metric that does not apply is left out.
    seconds, cpu_seconds : float
        Wall-clock time, and the time of all cores together.
    title : str
        What its sweep called the trial: scene, method, and what differs from the sweep's other trials.
    finished : str
        Time of the end in ISO format with its zone.
    parameters : dict
        The trial's configuration by group.
    """

    __pydantic_config__: ClassVar[ConfigDict] = {"allow_inf_nan": False, "extra": "ignore"}

    key: Annotated[str, Predicate(_is_key)]
    setting: str
    status: str
    dataset: str
    method: str
    cameras: str
    placement: str
    motion: str
    level: Annotated[float, Ge(0), Lt(1e100)]
    repeat: Count
    stand_in: bool = False
    n_bodies: Count | None = None
    n_points: Count | None = None
    n_frames: Count | None = None
    metrics: Metrics = field(default_factory=dict)
    seconds: Measured | None = None
    cpu_seconds: Measured | None = None
    peak_mb: Measured | None = None
    error: str = ""
    finished: Annotated[str, Predicate(_is_time)] = ""
    sweep: str = ""
    title: str = ""
    parameters: Parameters = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.status not in STATUSES:
            raise ValueError(f"status {self.status!r} is not one of {', '.join(STATUSES)}")
        infinite = [name for name, value in self.metrics.items() if not math.isfinite(value)]
        if infinite:
            raise ValueError(f"metrics must be finite, these are not: {', '.join(infinite)}")

    @classmethod
    def of_trial(cls, trial: Trial, key: str) -> Outcome:
        """The part of a trial's record that is known before it runs, with status failed."""
        placement = trial.dataset.get("placement", "")
        return cls(
            key=key,
            setting=trial.setting,
            status=FAILED,
            dataset=str(trial.dataset["name"]),
            method=str(trial.method["name"]),
            cameras=str(trial.cameras["source"]),
            placement=placement if isinstance(placement, str) else json.dumps([float(x) for x in placement]),
            motion=str(trial.dataset.get("motion", "")),
            level=float(trial.noise["level"]),
            repeat=int(trial.noise["repeat"]),
            n_bodies=trial.n_bodies if isinstance(trial.n_bodies, int) else None,
            parameters={name: dict(getattr(trial, name)) for name in GROUPS},
        )

    @property
    def gaps(self) -> str:
        """What was done to the observations: ``random 0.2, outliers 0.05, robust``; "" for nothing.

        Kind and share of what was dropped, the corruption, and how the tracks were cleaned.
        """
        words = {"gaps": gap_words, "corruption": corruption_words, "observations": observation_words}
        return ", ".join(text for name, of in words.items() if (text := of(self.parameters.get(name, {}))))

    @property
    def identity(self) -> tuple[Any, ...]:
        """Scene, method and noise draw: what a table's reader calls the row, whatever the method's settings."""
        words = (self.dataset, self.method, self.cameras, self.placement, self.motion)
        return (*words, self.level, self.gaps, self.repeat)

    def to_json(self) -> str:
        """JSON without absent values; half surrogate pairs, which UTF-8 cannot hold, become question marks."""
        values = {name: value for name, value in asdict(self).items() if value is not None}
        return json.dumps(values, indent=1, ensure_ascii=False).encode(errors="replace").decode() + "\n"

    @classmethod
    def from_json(cls, text: str | bytes) -> Outcome:
        """The record that :meth:`to_json` wrote, without fields of later versions; ValueError names a wrong field."""
        try:
            return checked(cls, text)
        except ValueError as error:
            raise ValueError(f"not a trial record: {error}") from None
