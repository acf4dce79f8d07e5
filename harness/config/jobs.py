"""The configurations of a sweep's jobs, composed together: as Hydra makes each, in a fraction of the time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from itertools import takewhile
from typing import Any, cast

from hydra import compose
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, OverrideType
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from nrsfm.harness.config.address import check as check_address
from nrsfm.harness.config.compose import configurations, one_line
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.trial import GROUPS

MISSING = "???"


def compose_jobs(jobs: Iterable[Sequence[str]]) -> Iterator[DictConfig]:
    """:func:`nrsfm.harness.config.compose.compose_config` of each job, files read as seldom as can be.

    Jobs that differ in plain values alone share their files: Hydra as well merges the files first and sets the values
    after. Jobs that differ in several choices of files are put together from the configurations that differ in one,
    wherever each of those changes keys of its own. Whatever is more than that is composed whole, unless it comes first
    and is the same in every job.
    """
    with configurations():
        composer = _Composer()
        for job in _split(jobs):
            yield composer.job(job)


def plain_jobs(jobs: Iterable[Sequence[str]]) -> Iterator[dict[str, Any]]:
    """:func:`resolved` of each of :func:`compose_jobs`.

    Interpolations are resolved once for every combination of files; a job that sets values which no interpolation
    mentions is a copy with those values in their place.

    Raises
    ------
    UsageError
        If a value is missing.
    """
    with configurations():
        composer = _Composer()
        for job in _split(jobs):
            base = composer.base(job)
            plain = base and base.at(job.values)
            yield plain or resolved(composer.job(job))


def resolved(cfg: DictConfig) -> dict[str, Any]:
    """A configuration as plain data, interpolations resolved.

    Raises
    ------
    UsageError
        If a value is missing, or a secret would stand where everybody reads it, see :func:`_check_secrets`.
    """
    try:
        plain = cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True))
    except OmegaConfBaseException as error:
        raise UsageError(f"configuration: {one_line(error)}") from None
    _check_secrets(cfg, plain)
    return plain


def _check_secrets(cfg: DictConfig, plain: Mapping[str, Any]) -> None:
    """Refuse variables of the environment in a trial's settings, which its record publishes, and a login written out.

    Only a configuration that is not resolved yet tells.
    """
    written = cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=False))
    for group in GROUPS:
        if "oc.env" in str(written.get(group)):
            raise UsageError(f"{group} holds oc.env: a trial's record would publish it; write the value itself")
    if (uri := plain["tracking"]["uri"]) != MISSING:
        check_address(str(written["tracking"]["uri"]), str(uri))


@dataclass(frozen=True)
class _Job:
    """The overrides of a job: choices of files by group, values that are the same in every job, and other values."""

    overrides: Sequence[str]
    choices: dict[str, str]
    fixed: tuple[str, ...]
    values: list[Override]


def _split(jobs: Iterable[Sequence[str]]) -> Iterator[_Job]:
    jobs = [list(job) for job in jobs]
    same = set(jobs[0]).intersection(*jobs) if jobs else set()
    parser, loader = OverridesParser.create(), GlobalHydra.instance().config_loader()
    parse = cache(lambda word: parser.parse_overrides([word])[0])
    is_group = cache(lambda key: bool(loader.get_group_options(key)))
    for job in jobs:
        parsed = [parse(word) for word in job]
        chosen = [o for o in parsed if is_group(o.key_or_group) and not isinstance(o.value(), dict)]
        values = [o for o in parsed if o not in chosen]
        fixed = tuple(str(o.input_line) for o in takewhile(lambda o: o.input_line in same, values))
        choices = {o.key_or_group: str(o.input_line) for o in chosen}
        yield _Job(job, choices, fixed, values[len(fixed) :])


@dataclass(frozen=True)
class _Base:
    """A resolved configuration whose values can be changed.

    ``mentioned`` are the words of its interpolations, ``missing`` the keys that have no value yet.
    """

    plain: dict[str, Any]
    mentioned: frozenset[str]
    missing: frozenset[str]

    @classmethod
    def of(cls, cfg: DictConfig) -> _Base | None:
        """None where what interpolations say depends on values that are missing, or on names that they make up."""
        try:
            plain = cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=True))
            _check_secrets(cfg, plain)
        except (OmegaConfBaseException, UsageError):  # the values of a job, such as tracking.uri, may put it right
            return None
        written = [text for _, text in _texts(OmegaConf.to_container(cfg, resolve=False)) if "${" in text]
        if any("${${" in text for text in written):
            return None
        missing = frozenset(key for key, text in _texts(plain) if text == MISSING)
        return cls(plain, frozenset(re.findall(r"\w+", " ".join(written))), missing)

    def at(self, values: Sequence[Override]) -> dict[str, Any] | None:
        """A copy with other values; None if it takes more than putting them in their place."""
        plain, given = _copied(self.plain), set()
        for override in values:
            keys, value = override.key_or_group.split("."), override.value()
            held: Any = plain
            for key in keys[:-1]:
                held = held.get(key) if isinstance(held, dict) else None
            simple = isinstance(held, dict) and keys[-1] in held and not isinstance(held[keys[-1]], dict | list)
            if keys[0] == "tracking":  # how it is written matters
                return None
            if not simple or not _is_value(override) or self.mentioned.intersection(keys):
                return None
            if isinstance(value, str) and ("${" in value or value == MISSING):
                return None
            held[keys[-1]] = value
            given.add(override.key_or_group)
        return None if self.missing - given else plain


class _Composer:
    """Composes choices of files: each once, and combinations from their parts."""

    def __init__(self) -> None:
        self._made: dict[tuple[str, ...], tuple[DictConfig, dict[str, Any]]] = {}
        self._first: dict[tuple[str, ...], dict[str, str]] = {}
        self._bases: dict[tuple[str, ...], _Base | None] = {}

    def job(self, job: _Job) -> DictConfig:
        """A configuration of its own."""
        cfg = self.compose(job.choices, job.fixed)
        if not all(_is_plain(o, cfg) for o in job.values):
            return cast(DictConfig, compose("config", overrides=list(job.overrides)))
        for o in job.values:
            OmegaConf.update(cfg, o.key_or_group, o.value())
        return cfg

    def base(self, job: _Job) -> _Base | None:
        """What jobs of the same choices and fixed values share."""
        words = (*job.choices.values(), *job.fixed)
        if words not in self._bases:
            self._bases[words] = _Base.of(self.compose(job.choices, job.fixed))
        return self._bases[words]

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
    return _is_value(override) and not OmegaConf.is_config(held)


def _is_value(override: Override) -> bool:
    """Whether an override gives a key a single value."""
    single = isinstance(override.value(), str | int | float | bool | None)
    return single and override.type is OverrideType.CHANGE and not override.is_sweep_override()


def _texts(tree: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """The texts of a tree with their dotted keys."""
    if isinstance(tree, str):
        yield key, tree
    elif isinstance(tree, dict | list):
        for name, branch in tree.items() if isinstance(tree, dict) else enumerate(tree):
            yield from _texts(branch, f"{key}.{name}" if key else str(name))


def _copied(tree: Any) -> Any:
    """A copy of plain data down to its leaves."""
    if isinstance(tree, dict):
        return {name: _copied(branch) for name, branch in tree.items()}
    return [_copied(branch) for branch in tree] if isinstance(tree, list) else tree
