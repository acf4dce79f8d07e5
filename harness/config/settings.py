from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from nrsfm.datasets.gaps import KINDS
from nrsfm.datasets.real.tracks import title
from nrsfm.harness.config.compose import WORDS
from nrsfm.harness.config.jobs import resolved
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.trial import AUTO, GROUPS, Trial


def settings_of(overrides: Sequence[str]) -> Settings:
    from nrsfm.harness.config.compose import compose_config
    from nrsfm.harness.config.settings import read

    return read(compose_config(overrides))[1]


LIMITS = ("seconds", "memory_gb", "sweep_seconds")


NAME = r"(?!\.+$)[A-Za-z0-9._+-]{1,100}"  # of sweeps, datasets and methods: they become folders, files and cells


@dataclass(frozen=True)
class Settings:
    """How and where a trial runs: all of the configuration that does not change its result.

    Parameters
    ----------
    output : Path
        Root of everything written.
    data : Path
        Folder of the real sequences.
    tracking_uri : str
    missing : {"error", "stand_in"}
        What an absent sequence becomes.
    rerun : {"none", "failed", "stale", "all"}
        Which trials that are done run again; stale ones were computed by other code or libraries than are here.
    threads : int
        BLAS threads of a trial.
    seconds, memory_gb : float
        Limits of a trial.
    retries : int
        How often a trial that was killed or ran out of memory is tried again.
    workers : int or None
        Processes that run trials side by side; None leaves it to the launcher.
    sweep_seconds : float
        Limit of the sweep.
    sweep : str
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


def read(cfg: DictConfig) -> tuple[Trial, Settings]:
    """:func:`read_plain` of a composed configuration."""
    return read_plain(resolved(cfg))


def read_plain(plain: dict[str, Any]) -> tuple[Trial, Settings]:
    """Split a resolved configuration into what is asked and how it is carried out.

    Raises
    ------
    UsageError
        If a value is of the wrong kind.
    """
    for key, allowed in WORDS.items():
        if plain[key] not in allowed:
            raise UsageError(f"{key} is {plain[key]!r}, wanted one of {', '.join(allowed)}")
    limits = plain["limits"]
    for key, value in {"threads": plain["threads"], **{f"limits.{name}": limits.get(name) for name in LIMITS}}.items():
        if value is None and key == "limits.sweep_seconds":
            continue
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < float("inf"):
            raise UsageError(f"{key} is {value!r}, wanted a positive number")
    retries = plain["retries"]
    if isinstance(retries, bool) or not isinstance(retries, int) or retries < 0:
        raise UsageError(f"retries is {retries!r}, wanted 0, 1, 2, ...")
    workers = plain["workers"]
    if isinstance(workers, bool) or not (workers is None or (isinstance(workers, int) and workers >= 1)):
        raise UsageError(f"workers is {workers!r}, wanted 1, 2, ..., or null")
    sweep = str(plain["sweep"] or "")
    if not re.fullmatch(NAME, sweep or "x"):
        raise UsageError(f"sweep is {sweep!r}, wanted letters, digits and . _ + -")
    return trial_of(plain), Settings(
        output=Path(plain["output"] or "outputs").resolve(),
        data=Path(plain["data"] or "data").resolve(),
        tracking_uri=tracking_uri(plain),
        missing=plain["missing"],
        rerun=plain["rerun"],
        threads=int(plain["threads"]),
        seconds=float(limits["seconds"]),
        memory_gb=float(limits["memory_gb"]),
        sweep_seconds=float(limits["sweep_seconds"] or "inf"),
        retries=retries,
        workers=workers,
        sweep=sweep,
    )


def tracking_uri(plain: Mapping[str, Any]) -> str:
    """The tracker's address; a SQLite file's path made absolute."""
    uri = str(plain["tracking"]["uri"])
    if uri.startswith("sqlite:///"):
        return f"sqlite:///{Path(uri.removeprefix('sqlite:///')).resolve()}"
    return uri


def trial_of(plain: Mapping[str, Any]) -> Trial:
    """The Trial of a resolved configuration; raises UsageError on values that no trial can have."""
    for group in GROUPS:
        if not isinstance(plain.get(group), Mapping):
            raise UsageError(f"{group} is {plain.get(group)!r}, wanted one of its choices; see 'nrsfm list'")
    dataset, method = dict(plain["dataset"]), dict(plain["method"])
    if dataset.get("name") is None:
        bodies = dataset.get("bodies")
        if "bodies" in dataset and not (isinstance(bodies, list) and bodies):
            raise UsageError(f"dataset.bodies is {bodies!r}, wanted a list such as [dance,yoga]")
        file = dataset.get("file") if dataset.get("source") == "tracks" else None
        dataset["name"] = "_".join(map(str, bodies)) if bodies else title(file) if file else dataset.get("source")
    for group, value in (("dataset", dataset.get("name")), ("method", method.get("name"))):
        if not (isinstance(value, str) and re.fullmatch(NAME, value)):
            raise UsageError(f"{group}.name is {value!r}, wanted letters, digits and . _ + -")
    _check_placement(dataset.get("placement", "paper"))
    level, repeat = plain["noise"].get("level"), plain["noise"].get("repeat")
    if isinstance(level, bool) or not isinstance(level, int | float) or not 0 <= level < float("inf"):
        raise UsageError(f"noise.level is {level!r}, wanted a number >= 0 (a share of the largest image coordinate)")
    if isinstance(repeat, bool) or not isinstance(repeat, int) or repeat < 0:
        raise UsageError(f"noise.repeat is {repeat!r}, wanted 0, 1, 2, ...")
    if plain["cameras"].get("source") not in ("known", "estimated"):
        raise UsageError(f"cameras.source is {plain['cameras'].get('source')!r}, wanted known or estimated")
    n_bodies = plain["n_bodies"]
    gaps = dict(plain["gaps"])
    share = gaps.get("share")
    if gaps.get("kind") not in KINDS:
        raise UsageError(f"gaps.kind is {gaps.get('kind')!r}, wanted one of {', '.join(KINDS)}")
    if isinstance(share, bool) or not isinstance(share, int | float) or not 0 <= share < 1:
        raise UsageError(f"gaps.share is {share!r}, wanted a number from 0 to less than 1")
    whole = isinstance(n_bodies, int) and not isinstance(n_bodies, bool) and n_bodies >= 1
    if not (whole or n_bodies in (None, AUTO)):
        raise UsageError(f"n_bodies is {n_bodies!r}, wanted a whole number >= 1, auto, or null for the scene's")
    return Trial(
        dataset=dataset,
        method=method,
        cameras=dict(plain["cameras"]),
        noise={"level": float(level), "repeat": repeat if level or share else 0},  # without either there is one draw
        gaps={} if gaps["kind"] == "none" or share == 0 else gaps | {"share": float(share)},
        n_bodies=n_bodies,
    )


def _check_placement(value: Any) -> None:
    numbers = (
        isinstance(value, list)
        and len(value) == 3
        and all(isinstance(x, int | float) and not isinstance(x, bool) and abs(x) < float("inf") for x in value)
    )
    if not (isinstance(value, str) or numbers):
        raise UsageError(f"dataset.placement is {value!r}, wanted paper, intersecting, or three numbers [x,y,z]")
