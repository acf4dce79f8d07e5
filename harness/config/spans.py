from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from hydra import compose
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, Override, RangeSweep

from nrsfm.harness.config.compose import configurations
from nrsfm.harness.config.jobs import plain_jobs
from nrsfm.harness.config.settings import Settings, read_plain
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.trial import Trial

MOST = 100_000  # trials of a sweep


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
        _check_number(everything)
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


def _check_number(overrides: Iterable[Override]) -> None:
    """Raise UsageError, before any list is made, if a sweep would have no end or more trials than can be meant."""
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
        for plain in plain_jobs(spanned(overrides)):
            trial, settings = read_plain(plain)
            seen.setdefault(trial.setting, (trial, settings))
    if not seen:
        raise UsageError("the sweep spans no trial")
    return list(seen.values())
