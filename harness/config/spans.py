"""A command line expanded into its trials."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hydra import compose
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.config_loader import ConfigLoader
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, Override, QuotedString, RangeSweep
from omegaconf import DictConfig

from nrsfm.harness.config.compose import configurations
from nrsfm.harness.config.jobs import plain_jobs
from nrsfm.harness.config.plugins import unknown_choice
from nrsfm.harness.config.settings import Settings, read_plain
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.trial import Trial

MOST = 100_000  # trials of a sweep


@dataclass(frozen=True)
class Request:
    """An expanded command line.

    Parameters
    ----------
    experiment : str or None
        The experiment that was asked for.
    trials : sequence of (Trial, Settings)
        Each trial once, in the order in which they run.
    config : mapping
        The resolved configuration of the first trial.
    hydra : DictConfig
        Hydra's own configuration: the launcher and the sweeper.
    launching : sequence of str
        The overrides that start a worker with the same launcher: the experiment, and Hydra's own keys.
    others : sequence of str
        The overrides without the choice of an experiment.
    """

    experiment: str | None
    trials: Sequence[tuple[Trial, Settings]]
    config: Mapping[str, Any]
    hydra: DictConfig
    launching: Sequence[str]
    others: Sequence[str]

    @classmethod
    def of(cls, overrides: Sequence[str], default: str | None = None) -> Request:
        """Expand overrides.

        Parameters
        ----------
        overrides : sequence of str
        default : str, optional
            The experiment of overrides that choose no experiment, no dataset and no method, and span no sweep.

        Raises
        ------
        UsageError
            If a job cannot be composed, has a value that no trial can have, or there are no jobs.
        """
        with configurations(overrides):
            line = _Line.of(overrides)
            if default and not line.names_trials:
                line = _Line.of([f"experiment={default}", *overrides])
            plain = list(plain_jobs(line.jobs()))
        if not plain:
            raise UsageError("the sweep spans no trial")
        trials: dict[str, tuple[Trial, Settings]] = {}
        for trial, settings in map(read_plain, plain):
            trials.setdefault(trial.setting, (trial, settings))
        others = [word for word, o in zip(line.words, line.parsed, strict=True) if o.key_or_group != "experiment"]
        return cls(line.experiment, list(trials.values()), plain[0], line.hydra, line.launching, others)

    @property
    def settings(self) -> Settings:
        """The settings of the first trial."""
        return self.trials[0][1]

    def with_experiment(self, name: str) -> Request:
        """The same overrides of another experiment."""
        return self if name == self.experiment else Request.of([f"experiment={name}", *self.others])


def expand(overrides: Sequence[str]) -> Sequence[tuple[Trial, Settings]]:
    """The trials of :meth:`Request.of`."""
    return Request.of(overrides).trials


def spanned(overrides: Sequence[str]) -> list[list[str]]:
    """The jobs that overrides span, each a list of plain overrides.

    The sweep of an experiment is in its ``hydra.sweeper.params``; an override of the same key replaces it. Each job
    begins with the overrides of Hydra's own keys.

    Raises
    ------
    UsageError
        If an override does not parse, or names an unknown key or choice.
    """
    with configurations(overrides):
        return _Line.of(overrides).jobs()


@dataclass(frozen=True)
class _Line:
    """Overrides, parsed, with Hydra's configuration for them.

    ``own`` are the overrides of Hydra's own keys, which are the same in every job.
    """

    words: Sequence[str]
    parsed: Sequence[Override]
    hydra: DictConfig
    own: Sequence[str]

    @classmethod
    def of(cls, words: Sequence[str]) -> _Line:
        loader = GlobalHydra.instance().config_loader()
        parsed = OverridesParser.create(loader).parse_overrides(list(words))
        for override in parsed:
            if override.key_or_group == "experiment" and override.is_sweep_override():
                raise UsageError(f"{override.input_line} names several experiments; give one, and run each on its own")
            if override.is_hydra_override() and override.is_sweep_override():
                raise UsageError(f"{override.input_line}: Hydra's own keys are the same in all trials; give one value")
        own = [str(o.input_line) for o in parsed if o.is_hydra_override()]
        deciding = [str(o.input_line) for o in parsed if _decides(o, loader)]
        return cls(words, parsed, compose("config", deciding, return_hydra_config=True).hydra, own)

    @property
    def experiment(self) -> str | None:
        name = self.hydra.runtime.choices.get("experiment")
        return None if name in (None, "null") else str(name)

    @property
    def launching(self) -> list[str]:
        """The overrides that start a worker with the same launcher."""
        return [*(str(o.input_line) for o in self.parsed if o.key_or_group == "experiment"), *self.own]

    @property
    def names_trials(self) -> bool:
        """Whether the overrides choose an experiment, a dataset or a method, or span a sweep."""
        chosen = any(o.is_sweep_override() or o.key_or_group in ("dataset", "method") for o in self.parsed)
        return chosen or self.experiment is not None

    def jobs(self) -> list[list[str]]:
        """The overrides of each job, in the order in which Hydra's own sweeper makes them."""
        params = [f"{key}={value}" for key, value in (self.hydra.sweeper.params or {}).items()]
        task = [str(o.input_line) for o in self.parsed if not o.is_hydra_override()]
        overrides = OverridesParser.create(GlobalHydra.instance().config_loader()).parse_overrides([*params, *task])
        last = {o.get_key_element(): o for o in overrides}.values()
        _check_number(last)
        for override in last:
            if override.is_sweep_override():
                _check_choices(override)
        batches: list[list[list[str]]] = BasicSweeper.split_arguments(overrides, None)
        return [[*self.own, *job] for batch in batches for job in batch]


def _decides(override: Override, loader: ConfigLoader) -> bool:
    """Whether an override can decide the sweep and the launcher: an experiment, Hydra's own key, or a value at the top.

    The values of a group may be of a choice that is swept, and cannot be set yet.
    """
    key = override.key_or_group
    if key == "experiment" or override.is_hydra_override():
        return True
    return not (override.is_sweep_override() or loader.get_group_options(re.split("[./]", key, maxsplit=1)[0]))


def _check_number(overrides: Iterable[Override]) -> None:
    """Raise UsageError, before any list is made, if a sweep has no end or more than :data:`MOST` trials."""
    total = 1.0
    for override in overrides:
        swept = override.value()
        if isinstance(swept, RangeSweep):
            first, last, step = (float(n or 0) for n in (swept.start, swept.stop, swept.step))
            total *= max(1.0, (last - first) / step) if step else float("inf")
        elif isinstance(swept, ChoiceSweep):
            total *= max(1, len(swept.list))
        if not total <= MOST:
            raise UsageError(f"{override.key_or_group} makes more than {MOST} trials; narrow its values")


def _check_choices(override: Override) -> None:
    """Raise UsageError if a sweep over a group names an unknown choice."""
    options = GlobalHydra.instance().config_loader().get_group_options(override.key_or_group)
    names = (v.text if isinstance(v, QuotedString) else v for v in override.sweep_iterator()) if options else ()
    unknown = [name for name in names if isinstance(name, str) and name.removesuffix(".yaml") not in options]
    if unknown:
        raise UsageError(unknown_choice(override.key_or_group, unknown[0], options))
