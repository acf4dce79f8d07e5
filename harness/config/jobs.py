"""The resolved configurations of a sweep's jobs: what Hydra composes for each, in a fraction of the time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, cast

from hydra import compose
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, OverrideType
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from nrsfm.harness.config.address import check as check_address
from nrsfm.harness.config.compose import configurations, one_line
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.trial import GROUPS


def plain_jobs(jobs: Iterable[Sequence[str]]) -> Iterator[dict[str, Any]]:
    """:func:`resolved` of the configuration of each job, each file read once.

    Jobs that differ in values alone share one configuration, in which the values are set: Hydra as well merges files
    first and sets values after. The files of all choices are read in one composition, see :class:`_Composed`.

    Raises
    ------
    UsageError
        If a job cannot be composed or a value is missing.
    """
    words = list(jobs)
    with configurations([word for job in words[:1] for word in job]):
        read = _Reader()
        read_jobs = [read(job) for job in words]
        alike: dict[tuple[str, ...], list[Mapping[str, str]]] = {}  # choices of the jobs that share configurations
        for job in read_jobs:
            alike.setdefault(job.kind, []).append(job.choices)
        composed = {job.kind: _Composed(alike[job.kind], job.merged) for job in read_jobs}
        for job in read_jobs:
            yield composed[job.kind].plain(job.choices, job.values)


@dataclass(frozen=True)
class _Job:
    """A job's overrides, told apart by what Hydra does with them.

    Parameters
    ----------
    choices : mapping
        The overrides ``GROUP=NAME`` by group.
    merged : sequence of str
        What else wants Hydra, in the order given: its own keys, choices in other packages, what is added or removed,
        and all values of the keys that these touch.
    values : sequence of Override
        The other ``KEY=VALUE``, each of which replaces what was before.
    """

    choices: Mapping[str, str]
    merged: Sequence[str]
    values: Sequence[Override]

    @cached_property
    def kind(self) -> tuple[str, ...]:
        """Jobs of one kind share configurations."""
        return (*self.choices, *self.merged, *(o.key_or_group for o in self.values))


class _Reader:
    """Tells the overrides of jobs apart."""

    def __init__(self) -> None:
        loader = GlobalHydra.instance().config_loader()
        parser = OverridesParser.create(loader)
        self._parse = cache(lambda word: parser.parse_overrides([word])[0])
        self._is_group = cache(lambda key: bool(loader.get_group_options(key)))

    def __call__(self, job: Sequence[str]) -> _Job:
        overrides: list[Override] = [self._parse(word) for word in job]
        choices = {o.key_or_group: str(o.input_line) for o in overrides if self._is_choice(o)}
        others = [o for o in overrides if not self._is_choice(o)]
        tops = {_top(o) for o in others if not self._is_value(o)}
        merged = [str(o.input_line) for o in others if _top(o) in tops]
        return _Job(choices, merged, [o for o in others if _top(o) not in tops])

    def _is_choice(self, o: Override) -> bool:
        return _is_plain(o) and isinstance(o.value(), str) and self._is_group(o.key_or_group)

    def _is_value(self, o: Override) -> bool:
        """Whether an override replaces the value of a key, whatever it was before."""
        return _is_plain(o) and not isinstance(o.value(), dict) and not self._is_group(o.key_or_group)


class _Composed:
    """Configurations of jobs that choose files in the same groups and set the same keys.

    The first job's files are composed as Hydra does it. The other choices are composed together, each under a key of
    its own, and take the place of the first job's, in groups that nothing but their choice touches. Choices in the
    other groups are composed by Hydra one by one.
    """

    def __init__(self, jobs: Sequence[Mapping[str, str]], merged: Sequence[str]) -> None:
        self._first, self._merged = jobs[0], merged
        self._choices = {group: list(dict.fromkeys(job[group] for job in jobs)) for group in jobs[0]}
        self._bases: dict[tuple[str, ...], _Base] = {}
        self._fixed: dict[tuple[str, ...], dict[str, Any]] = {}

    def plain(self, choices: Mapping[str, str], values: Sequence[Override]) -> dict[str, Any]:
        """The resolved configuration of choices by group and of values; only sections that can change are resolved."""
        base = self._compose(choices)
        try:
            for o in values:
                OmegaConf.update(base.cfg, o.key_or_group, o.value())
        except OmegaConfBaseException:  # Hydra explains it
            compose("config", overrides=[*choices.values(), *self._merged, *(str(o.input_line) for o in values)])
            raise
        words, keys = tuple(choices.values()), {part for o in values for part in o.key_or_group.split(".")}
        simple = "tracking" not in keys and not any(re.search(r"\$|\?{3}", str(o.value())) for o in values)
        if simple and words in self._fixed:
            fixed = self._fixed[words]
            with suppress(OmegaConfBaseException):  # resolved() explains it
                return {**fixed, **{str(key): _section(base.cfg[key]) for key in base.cfg if key not in fixed}}
        plain = resolved(base.cfg)
        changing = {_top(o) for o in values}
        interpolated = {key: str(section) for key, section in base.written.items() if "${" in str(section)}
        text = " ".join(interpolated.values())
        if keys.intersection(re.findall(r"\w+", text)) or re.search(r"\$\{[^}]*\$\{", text):
            changing |= interpolated.keys()
        self._fixed[words] = {key: section for key, section in plain.items() if key not in changing}
        return plain

    def _compose(self, choices: Mapping[str, str]) -> _Base:
        """The configuration of choices; values of the jobs before are still set in it."""
        apart = self._sections if choices != self._first else {}
        chosen = {group: self._first[group] if word in apart else word for group, word in choices.items()}
        words = tuple(chosen.values())
        if words not in self._bases:
            cfg = compose("config", overrides=[*words, *self._merged])
            self._bases[words] = _Base(cfg, _written(cfg), chosen)
        base = self._bases[words]
        for group, word in choices.items():
            if base.choices[group] != word:
                base.choices[group], base.written[group] = word, self._sections[word]
                base.cfg[group] = self._sections[word]
        return base

    @cached_property
    def _sections(self) -> Mapping[str, Any]:
        """The section of each choice as written, of the groups that nothing but their choice touches."""
        touched = {word.lstrip("+~").partition("=")[0].partition(".")[0] for word in self._merged}
        swept = {
            group: words
            for group, words in self._choices.items()
            if len(words) > 1 and group not in touched and not any(map(_places_itself, words))
        }
        keys = {word: f"_{i}" for i, word in enumerate(word for words in swept.values() for word in words)}
        placed = [f"+{word.replace('=', f'@{key}=', 1)}" for word, key in keys.items()]
        kept = [word for group, word in self._first.items() if group not in swept]
        left_out = [f"~{group}" for group in swept]
        try:
            together = _written(compose("config", overrides=[*left_out, *placed, *kept, *self._merged]))
        except (HydraException, OmegaConfBaseException):  # a word is more than GROUP=CHOICE, or files ask for a choice
            return {}
        sections = {word: together.pop(key) for word, key in keys.items()}
        first = self._compose(self._first).written
        if any(together.get(key) != value for key, value in first.items() if key not in swept):
            return {}
        alone = [g for g in swept if g not in together and sections[self._first[g]] == first[g]]
        return {word: sections[word] for group in alone for word in swept[group]}


def _places_itself(choice: str) -> bool:
    """Whether the file of ``GROUP=NAME`` says where it stands, which need not be under the key GROUP."""
    path = choice.replace("=", "/", 1)
    sources = GlobalHydra.instance().config_loader().get_sources()
    first = next((source for source in sources if source.is_config(path)), None)
    return first is not None and first.load_config(path).header.get("package") is not None


@dataclass
class _Base:
    """A composed configuration, how it is written without values, and the choices that it holds now, by group."""

    cfg: DictConfig
    written: dict[str, Any]
    choices: dict[str, str]


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
    """The first part of an override's key."""
    return re.split("[./]", override.key_or_group, maxsplit=1)[0]


def _is_plain(o: Override) -> bool:
    """Whether an override changes a key or a choice of the application, in its own package."""
    return o.type is OverrideType.CHANGE and o.package is None and _top(o) != "hydra"
