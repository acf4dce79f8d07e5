"""Trials and their settings, read from resolved configurations."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from nrsfm.datasets.real.tracks import title
from nrsfm.harness.config.address import SQLITE, file_of
from nrsfm.harness.config.compose import compose_config
from nrsfm.harness.config.jobs import resolved
from nrsfm.harness.config.schema import NAME, validated
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.trial import Trial


@dataclass(frozen=True)
class Settings:
    """The part of the configuration that does not change a trial's result: where and how it runs.

    Parameters
    ----------
    output : Path
        Root of everything written.
    data : Path
        Folder of the real sequences.
    tracking_uri : str
    missing : {"error", "stand_in"}
        What replaces a real sequence that is missing: nothing, or generated bodies.
    rerun : {"none", "failed", "stale", "all"}
        Which finished trials run again; stale ones were computed by other code or other libraries.
    threads : int
        BLAS threads of a trial.
    seconds, memory_gb : float
        Limits of a trial.
    retries : int
        Further tries of a trial that was killed or ran out of memory.
    workers : int or None
        Processes that run trials side by side; None lets the launcher choose.
    sweep_seconds : float
        Limit of the sweep.
    sweep : str
        Name of the sweep; "" makes one from the time.
    """

    output: Path
    data: Path
    tracking_uri: str = field(repr=False)  # may hold a login
    missing: str = "error"
    rerun: str = "none"
    threads: int = 1
    seconds: float = 3600.0
    memory_gb: float = 8.0
    retries: int = 1
    workers: int | None = None
    sweep_seconds: float = float("inf")
    sweep: str = ""

    @property
    def trials(self) -> Path:
        return self.output / "trials"


def settings_of(overrides: Sequence[str]) -> Settings:
    """The settings of a single configuration."""
    return read(compose_config(overrides))[1]


def read(cfg: DictConfig) -> tuple[Trial, Settings]:
    """:func:`read_plain` of a composed configuration."""
    return read_plain(resolved(cfg))


def read_plain(plain: dict[str, Any]) -> tuple[Trial, Settings]:
    """Split a resolved configuration into the trial and its settings.

    Raises
    ------
    UsageError
        If a value is of the wrong kind, or a key is missing or unknown.
    """
    config = validated(plain)
    noise, gaps, corruption = config.noise, config.gaps, config.corruption
    drawn = noise.level or gaps.share or corruption.any
    trial = Trial(
        dataset=_named(plain["dataset"]),
        method=dict(plain["method"]),
        cameras=dict(plain["cameras"]),
        noise={"level": noise.level, "repeat": noise.repeat if drawn else 0},  # else one draw
        gaps={} if gaps.kind == "none" or gaps.share == 0 else plain["gaps"] | {"share": gaps.share},
        corruption=plain["corruption"] if corruption.any else {},
        observations=plain["observations"] if config.observations.any else {},
        n_bodies=config.n_bodies,
    )
    return trial, Settings(
        output=Path(config.output or "outputs").resolve(),
        data=Path(config.data or "data").resolve(),
        tracking_uri=_absolute(str(config.tracking.uri)),
        missing=config.missing,
        rerun=config.rerun,
        threads=config.threads,
        seconds=config.limits.seconds,
        memory_gb=config.limits.memory_gb,
        sweep_seconds=config.limits.sweep_seconds or float("inf"),
        retries=config.retries,
        workers=config.workers,
        sweep=config.sweep or "",
    )


def _named(dataset: Mapping[str, Any]) -> dict[str, Any]:
    """The dataset's settings with its name: that of its bodies, of its file, or of its source."""
    if dataset.get("name") is not None:
        return dict(dataset)
    bodies = dataset.get("bodies")
    if "bodies" in dataset and not (isinstance(bodies, list) and bodies):
        raise UsageError(f"dataset.bodies is {bodies!r}, wanted a list such as [dance,yoga]")
    if bodies:
        name = "_".join(map(str, bodies))
    elif dataset.get("source") == "tracks" and dataset.get("file"):
        name = title(dataset["file"])
    else:
        name = str(dataset.get("source"))
    if not re.fullmatch(NAME, name):
        raise UsageError(f"dataset.name is {name!r}, wanted letters, digits and . _ + -")
    return dict(dataset) | {"name": name}


def _absolute(uri: str) -> str:
    """A tracker's address, a SQLite file's path made absolute."""
    path = file_of(uri)
    return uri if path is None else f"{SQLITE}{path.resolve()}"
