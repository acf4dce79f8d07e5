"""From configuration to trials: composition, and the grid that a sweep spans."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from itertools import takewhile
from pathlib import Path
from typing import Any, cast

from hydra import compose
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, OverrideType
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from datasets.gaps import KINDS
from datasets.tracks import title
from harness.configurations import WORDS, configurations, one_line
from harness.configurations import compose_config as compose_config
from harness.record import AUTO, Trial, UsageError

LIMITS = ("seconds", "memory_gb", "sweep_seconds")
NAME = r"[A-Za-z0-9._+-]{1,100}"  # of sweeps, datasets and methods: they become folders, files and cells


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
    tracking_uri: str
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
    """Split a composed configuration into what is asked and how it is carried out.

    Raises
    ------
    UsageError
        If a value is missing or of the wrong kind.
    """
    try:
        plain = OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True)
    except OmegaConfBaseException as error:
        raise UsageError(f"configuration: {one_line(error)}") from None
    plain = cast(dict[str, Any], plain)
    for key, allowed in WORDS.items():
        if plain[key] not in allowed:
            raise UsageError(f"{key} is {plain[key]!r}, wanted one of {', '.join(allowed)}")
    limits = plain["limits"]
    for key in ("threads", *(f"limits.{name}" for name in LIMITS)):
        value = OmegaConf.select(cfg, key)
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
    for group in ("dataset", "method", "cameras", "noise", "gaps"):
        if not isinstance(plain.get(group), Mapping):
            raise UsageError(f"{group} is {plain.get(group)!r}, wanted one of its choices; see 'harness list'")
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


def spanned(overrides: Sequence[str]) -> list[list[str]]:
    """The jobs that overrides span, each a list of plain overrides.

    An experiment's sweep parameters are those of its ``hydra.sweeper.params``; a command-line override of the same
    key takes their place.

    Raises
    ------
    UsageError
        If an override does not parse, or names a key or a choice that is not there.
    """
    with configurations():
        parser = OverridesParser.create()
        own = compose("config", overrides=launching(overrides), return_hydra_config=True).hydra.sweeper.params or {}
        keys = {o.key_or_group for o in parser.parse_overrides(list(overrides))}
        words = [*(f"{key}={value}" for key, value in own.items() if key not in keys), *overrides]
        everything = parser.parse_overrides(words)
        for override in everything:
            if override.is_sweep_override():
                _check_choices(override)
        batches: list[list[list[str]]] = BasicSweeper.split_arguments(everything, None)
        return [job for batch in batches for job in batch]


def launching(overrides: Sequence[str]) -> list[str]:
    """What Hydra needs of the overrides to start the workers: the experiment and its own keys, of single values."""
    with configurations():
        parsed = OverridesParser.create().parse_overrides(list(overrides))
    own = [o for o in parsed if o.key_or_group == "experiment" or re.match(r"hydra[./]", o.key_or_group)]
    return [str(o.input_line) for o in own if not o.is_sweep_override()]


def _check_choices(override: Override) -> None:
    """Raise UsageError if a swept group is to take a choice that is not there."""
    options = GlobalHydra.instance().config_loader().get_group_options(override.key_or_group)
    unknown = [str(v) for v in override.sweep_iterator() if str(v) not in options] if options else []
    if unknown:
        raise UsageError(f"{override.key_or_group} {unknown[0]!r} is none of {', '.join(options)}")


def expand(overrides: Sequence[str]) -> list[tuple[Trial, Settings]]:
    """The trials of an experiment or sweep, each once, in the order in which they would run.

    Raises
    ------
    UsageError
        If a job cannot be composed, holds a value that no trial can have, or there is none.
    """
    with configurations():
        seen: dict[str, tuple[Trial, Settings]] = {}
        for cfg in compose_jobs(spanned(overrides)):
            trial, settings = read(cfg)
            seen.setdefault(trial.setting, (trial, settings))
    if not seen:
        raise UsageError("the sweep spans no trial")
    return list(seen.values())


def compose_jobs(jobs: Iterable[Sequence[str]]) -> Iterator[DictConfig]:
    """:func:`harness.configurations.compose_config` of each job, files read as seldom as can be.

    Jobs that differ in plain values alone share their files: Hydra as well merges the files first and sets the values
    after. Jobs that differ in several choices of files are put together from the configurations that differ in one,
    wherever each of those changes keys of its own. Whatever is more than that is composed whole, unless it comes first
    and is the same in every job.
    """
    jobs = [list(job) for job in jobs]
    same = set(jobs[0]).intersection(*jobs) if jobs else set()
    with configurations():
        parser, loader = OverridesParser.create(), GlobalHydra.instance().config_loader()
        is_group = cache(lambda key: bool(loader.get_group_options(key)))
        composer = _Composer()
        for job in jobs:
            parsed = parser.parse_overrides(job)
            chosen = [o for o in parsed if is_group(o.key_or_group) and not isinstance(o.value(), dict)]
            values = [o for o in parsed if o not in chosen]
            fixed = list(takewhile(lambda o: o.input_line in same, values))
            cfg = composer.compose(
                {o.key_or_group: str(o.input_line) for o in chosen}, [str(o.input_line) for o in fixed]
            )
            rest = values[len(fixed) :]
            if all(_is_plain(o, cfg) for o in rest):
                for o in rest:
                    OmegaConf.update(cfg, o.key_or_group, o.value())
                yield cfg
            else:
                yield compose("config", overrides=job)


class _Composer:
    """Composes choices of files: each once, and combinations from their parts."""

    def __init__(self) -> None:
        self._made: dict[tuple[str, ...], tuple[DictConfig, dict[str, Any]]] = {}
        self._first: dict[tuple[str, ...], dict[str, str]] = {}

    def compose(self, choices: dict[str, str], values: Sequence[str]) -> DictConfig:
        """A configuration of its own for choices by group, as overrides, and values that come after them."""
        first = self._first.setdefault(tuple(choices), choices)
        changed = [group for group, choice in choices.items() if choice != first[group]]
        if len(changed) < 2:
            return deepcopy(self._whole(choices, values)[0])
        cfg, plain = self._whole(first, values)
        parts: dict[str, Any] = {}
        for group in changed:
            part = self._whole(first | {group: choices[group]}, values)[1]
            own = {key for key in part if key not in plain or part[key] != plain[key]}
            if part.keys() != plain.keys() or own & parts.keys():
                return deepcopy(self._whole(choices, values)[0])
            parts |= {key: part[key] for key in own}
        cfg = deepcopy(cfg)
        for key, value in parts.items():
            cfg[key] = value
        return cfg

    def _whole(self, choices: Mapping[str, str], values: Sequence[str]) -> tuple[DictConfig, dict[str, Any]]:
        """A composed configuration, and the same as plain data with its interpolations as they are written."""
        words = (*choices.values(), *values)
        if words not in self._made:
            cfg = compose("config", overrides=list(words))
            self._made[words] = cfg, cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=False))
        return self._made[words]


def _is_plain(override: Override, cfg: DictConfig) -> bool:
    """Whether an override gives a single value to a key that has one."""
    held = OmegaConf.select(cfg, override.key_or_group, default=cfg)
    plain = isinstance(override.value(), str | int | float | bool | None) and not OmegaConf.is_config(held)
    return plain and override.type is OverrideType.CHANGE and not override.is_sweep_override()
