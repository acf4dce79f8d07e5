"""The resolved configurations of a sweep's jobs: what Hydra composes for each, in a fraction of the time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from functools import cache
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


def plain_jobs(jobs: Iterable[Sequence[str]]) -> Iterator[dict[str, Any]]:
    """:func:`resolved` of the configuration of each job, files read as seldom as can be.

    Jobs that differ in values alone share one configuration, in which the values are set: Hydra as well merges files
    first and sets values after. The configuration of several choices of files is put together from those that differ
    in one, wherever each choice changes keys of its own.

    Raises
    ------
    UsageError
        If a job cannot be composed or a value is missing.
    """
    with configurations():
        parser, loader = OverridesParser.create(), GlobalHydra.instance().config_loader()
        parse = cache(lambda word: parser.parse_overrides([word])[0])
        is_group = cache(lambda key: bool(loader.get_group_options(key)))
        composed: dict[tuple[str, ...], _Composed] = {}
        for job in jobs:
            overrides: list[Override] = [parse(word) for word in job]
            choices = {
                o.key_or_group: str(o.input_line)
                for o in overrides
                if is_group(o.key_or_group) and not isinstance(o.value(), dict)
            }
            others = [o for o in overrides if o.key_or_group not in choices]
            merged = {_top(o) for o in others if not _is_value(o)}  # these keys want Hydra, in the order given
            words = [str(o.input_line) for o in others]
            alike = (*choices, *(str(o.input_line) if _top(o) in merged else o.key_or_group for o in others))
            values = [o for o in others if _top(o) not in merged]
            yield composed.setdefault(alike, _Composed(choices, words)).plain(choices, values)


class _Composed:
    """Configurations of jobs that set the same keys, by their choices of files; the values are those of the first."""

    def __init__(self, first: Mapping[str, str], words: Sequence[str]) -> None:
        self._first, self._words = first, words
        self._made: dict[tuple[str, ...], tuple[DictConfig, dict[str, Any]]] = {}
        self._fixed: dict[tuple[str, ...], dict[str, Any]] = {}

    def plain(self, choices: Mapping[str, str], values: Sequence[Override]) -> dict[str, Any]:
        """The resolved configuration of choices by group and of values; only sections that can change are resolved."""
        cfg, written = self._compose(choices)
        for o in values:
            OmegaConf.update(cfg, o.key_or_group, o.value())
        words, keys = tuple(choices.values()), {part for o in values for part in o.key_or_group.split(".")}
        simple = "tracking" not in keys and not any(re.search(r"\$|\?{3}", str(o.value())) for o in values)
        if simple and words in self._fixed:
            fixed = self._fixed[words]
            with suppress(OmegaConfBaseException):  # resolved() explains it
                return {**fixed, **{str(key): _section(cfg[key]) for key in cfg if key not in fixed}}
        plain = resolved(cfg)
        changing = {_top(o) for o in values}
        interpolated = {key: str(section) for key, section in written.items() if "${" in str(section)}
        text = " ".join(interpolated.values())
        if keys.intersection(re.findall(r"\w+", text)) or re.search(r"\$\{[^}]*\$\{", text):
            changing |= interpolated.keys()
        self._fixed[words] = {key: section for key, section in plain.items() if key not in changing}
        return plain

    def _compose(self, choices: Mapping[str, str]) -> tuple[DictConfig, dict[str, Any]]:
        """A configuration, and as it was written before any value was set."""
        words = tuple(choices.values())
        if words not in self._made:
            cfg = self._combine(choices) or compose("config", overrides=[*words, *self._words])
            self._made[words] = cfg, _written(cfg)
        return self._made[words]

    def _combine(self, choices: Mapping[str, str]) -> DictConfig | None:
        """A configuration put together from those that differ from the first in one choice; None if that fails."""
        changed = [group for group, choice in choices.items() if choice != self._first[group]]
        if len(changed) < 2:
            return None
        combined, before = deepcopy(self._compose(self._first))
        taken: set[str] = set()
        for group in changed:
            part = self._compose({**self._first, group: choices[group]})[1]
            own = {key for key in part if key not in before or part[key] != before[key]}
            if part.keys() != before.keys() or own & taken:
                return None
            taken |= own
            for key in own:
                combined[key] = part[key]
        return combined


def resolved(cfg: DictConfig) -> dict[str, Any]:
    """A configuration as plain data, interpolations resolved.

    Raises
    ------
    UsageError
        If a value is missing, a trial's settings hold variables of the environment, which its record would publish, or
        the tracker's address holds a login.
    """
    try:
        plain = cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True))
    except OmegaConfBaseException as error:
        raise UsageError(f"configuration: {one_line(error)}") from None
    written = _written(cfg)
    for group in GROUPS:
        if "oc.env" in str(written.get(group)):
            raise UsageError(f"{group} holds oc.env: a trial's record would publish it; write the value itself")
    check_address(str(written["tracking"]["uri"]), str(plain["tracking"]["uri"]))
    return plain


def _section(value: Any) -> Any:
    is_config = OmegaConf.is_config(value)
    return OmegaConf.to_container(value, resolve=True, throw_on_missing=True) if is_config else value


def _written(cfg: DictConfig) -> dict[str, Any]:
    """A configuration as plain data, interpolations as they are written."""
    return cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=False))


def _top(override: Override) -> str:
    return str(override.key_or_group).partition(".")[0]


def _is_value(override: Override) -> bool:
    """Whether an override replaces the value of a key, whatever it was before."""
    return override.type is OverrideType.CHANGE and not isinstance(override.value(), dict) and _top(override) != "hydra"
