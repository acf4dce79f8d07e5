"""The schema of the resolved configuration: the keys of each group, and the values that they take.

Hydra refuses keys that no configuration file has. This schema also refuses what files and ``+key=value`` can add, and
values of the wrong kind. Settings of a method are checked by its class, values of a dataset by its source.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, FiniteFloat, ValidationError

from nrsfm.datasets.corruption import ZOOMS
from nrsfm.datasets.gaps import KINDS
from nrsfm.harness.config.compose import WORDS, Missing, Rerun
from nrsfm.harness.record.errors import UsageError

#: Names of sweeps, datasets and methods: they become folders, files and cells.
NAME = r"(?!\.+$)[A-Za-z0-9._+-]{1,100}"

LETTERS = "letters, digits and . _ + -"
POSITIVE = "a positive number"

_PLACED = ("placement", "upright", "scale", "degrees_per_frame")
_THINNED = ("take", "range", "stride", "frames", "degrees_per_frame")

#: The keys of each source of datasets, besides ``source`` and ``name``; other packages' sources take any.
SOURCE_KEYS: Mapping[str, tuple[str, ...]] = {
    "procedural": ("bodies", "points", "frames", "seed", *_PLACED),
    "mocap": ("bodies", "motion", "registration", "frames", *_PLACED),
    "mocap_body": ("body", "rank", "published_rank"),
    "two_person": _THINNED,
    "take": (*_THINNED, "folder", "persons", "others", "vertical", "video_rate", "least_seen"),
    "garg": ("face", "sequence", "points", "frames", "neighbours", "fields"),
    "hopkins155": ("scene",),
    "tracks": ("file", "columns", "axes", "confidence", "y"),
}


def _check_name(name: str) -> str:
    if not re.fullmatch(NAME, name):
        raise ValueError("no name")
    return name


Name = Annotated[str, AfterValidator(_check_name)]


class _Model(BaseModel):
    """Validates plain data without converting words to numbers; a field's description says what is wanted."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class Limits(_Model):
    """Limits of a trial and of the sweep."""

    seconds: float = Field(gt=0, allow_inf_nan=False, description=POSITIVE)
    memory_gb: float = Field(gt=0, allow_inf_nan=False, description=POSITIVE)
    sweep_seconds: float | None = Field(gt=0, allow_inf_nan=False, description=POSITIVE)


class Noise(_Model):
    """Level and number of the draw."""

    level: float = Field(
        ge=0, allow_inf_nan=False, description="a number >= 0 (a share of the largest image coordinate)"
    )
    repeat: int = Field(ge=0, description="0, 1, 2, ...")


class Gaps(_Model):
    """Dropped observations."""

    kind: str = Field(pattern=f"^({'|'.join(KINDS)})$", description=f"one of {', '.join(KINDS)}")
    share: float = Field(ge=0, lt=1, description="a number from 0 to less than 1")
    length: Any = None


SHARE = "a number from 0 to less than 1"


class Corruption(_Model):
    """Outliers, jumps and zoom."""

    outliers: float = Field(ge=0, lt=1, description=SHARE)
    jumps: float = Field(ge=0, lt=1, description=SHARE)
    zoom: float = Field(ge=0, lt=1, description=SHARE)
    zooming: str = Field(pattern=f"^({'|'.join(ZOOMS)})$", description=f"one of {', '.join(ZOOMS)}")

    @property
    def any(self) -> bool:
        return bool(self.outliers or self.jumps or self.zoom)


class Observed(_Model):
    """How tracks are cleaned before the method."""

    robust: bool = Field(description="true or false")
    scale: bool = Field(description="true or false")

    @property
    def any(self) -> bool:
        return self.robust or self.scale


class Cameras(_Model):
    """Known cameras, or how they are estimated."""

    source: Literal["known", "estimated", "refined"] = Field(description="known, estimated or refined")
    rank: Any = None
    start: Any = None
    refine: Any = None
    turning: Any = None
    smoothing: Any = None
    noise: Any = None
    iterations: Any = None


class Tracking(_Model):
    """Address of the tracker."""

    uri: str | None = Field(description="sqlite:///FILE, or http://HOST:PORT of a server")


class Dataset(BaseModel):
    """What datasets of all sources have in common; see :data:`SOURCE_KEYS`."""

    model_config = ConfigDict(strict=True, extra="allow", frozen=True)
    source: Any = None
    name: Name | None = Field(None, description=LETTERS)
    placement: str | Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)] = Field(
        "paper", description="paper, intersecting, or three numbers [x,y,z]"
    )


class Method(BaseModel):
    """The method's name; its class checks the rest."""

    model_config = ConfigDict(strict=True, extra="allow", frozen=True)
    name: Name = Field(description=LETTERS)


class Configuration(BaseModel):
    """A resolved configuration. Experiments may add keys of their own at the top, which others refer to."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True)
    dataset: Dataset
    method: Method
    cameras: Cameras
    noise: Noise
    gaps: Gaps
    corruption: Corruption
    observations: Observed
    n_bodies: Annotated[int, Field(ge=1)] | Literal["auto"] | None = Field(
        description="a whole number >= 1, auto, or null for the scene's"
    )
    missing: Missing = Field(description=f"one of {', '.join(WORDS['missing'])}")
    rerun: Rerun = Field(description=f"one of {', '.join(WORDS['rerun'])}")
    threads: int = Field(ge=1, description="1, 2, ...")
    retries: int = Field(ge=0, description="0, 1, 2, ...")
    workers: int | None = Field(ge=1, description="1, 2, ..., or null")
    limits: Limits
    tracking: Tracking
    sweep: Annotated[Name | None, BeforeValidator(lambda name: str(name) if name else None)] = Field(
        description=LETTERS
    )
    output: Any
    data: Any


def validated(plain: Mapping[str, Any]) -> Configuration:
    """Validate a resolved configuration.

    Raises
    ------
    UsageError
        If a value is of the wrong kind, or a key is missing or unknown: its key, the value, and what is wanted.
    """
    try:
        configuration = Configuration.model_validate(plain)
    except ValidationError as error:
        raise UsageError(_message(error)) from None
    dataset = plain["dataset"]
    known = SOURCE_KEYS.get(str(dataset.get("source")))
    if known is not None and (unknown := [key for key in dataset if key not in (*known, "source", "name")]):
        raise UsageError(f"dataset.{unknown[0]} is unknown to {dataset['source']}, which has {', '.join(known)}")
    return configuration


def _message(error: ValidationError) -> str:
    """The first error in one line."""
    first = error.errors(include_url=False)[0]
    fields = _fields()
    key = next(k for k in _prefixes(first["loc"]) if k in fields or first["type"] == "extra_forbidden")
    if first["type"] == "extra_forbidden":
        group = key.rpartition(".")[0]
        names = [name.rpartition(".")[2] for name in fields if name.rpartition(".")[0] == group]
        return f"{key} is unknown, {group} has {', '.join(names)}"
    if first["type"] == "missing":
        return f"{key} is missing, wanted {fields[key]}"
    value = first["input"]
    return f"{key} is {value!r}, wanted {fields[key]}"


def _prefixes(location: tuple[int | str, ...]) -> Iterator[str]:
    """Dotted keys of an error's location, the longest first: unions add parts that are no keys."""
    for n in range(len(location), 0, -1):
        yield ".".join(map(str, location[:n]))


@cache
def _fields() -> dict[str, str]:
    """Dotted keys of the schema, each with what is wanted."""
    fields = {}
    for name, field in Configuration.model_fields.items():
        fields[name] = field.description or "one of its choices; see 'nrsfm list'"
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            for key, below in field.annotation.model_fields.items():
                fields[f"{name}.{key}"] = below.description or "a value"
    return fields
