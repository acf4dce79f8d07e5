"""Composition by Hydra from the configurations of this package and of installed packages. Loads no method."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Literal, get_args

from hydra import compose, initialize_config_module
from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra._internal.sources_registry import SourcesRegistry
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Quote, QuotedString
from hydra.core.plugins import Plugins
from hydra.errors import HydraException
from hydra.plugins.config_source import ConfigResult
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException
from yaml import YAMLError

from nrsfm.harness.config.aliases import check_file
from nrsfm.harness.config.plugins import folders
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.text import did_you_mean, printable

#: What replaces a real sequence that is missing, and which finished trials run again.
Missing = Literal["error", "stand_in"]
Rerun = Literal["none", "failed", "stale", "all"]

#: Keys that take one of a few words.
WORDS: dict[str, tuple[str, ...]] = {"missing": get_args(Missing), "rerun": get_args(Rerun)}


#: The folders that overrides add to Hydra's search path, while Hydra is initialised with them.
_ADDED: ContextVar[tuple[str, ...]] = ContextVar("_ADDED", default=())


class Configurations(SearchPathPlugin):  # type: ignore[misc]  # Hydra is untyped
    """Adds the configurations of installed packages to Hydra's search path, and then those that overrides add."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        for package, folder in folders().items():
            search_path.append(package, f"file://{folder}")
        for place in _ADDED.get():
            search_path.append("command-line", place)


class _Checked(FileConfigSource):  # type: ignore[misc]
    """Reads files in folders of others."""

    def load_config(self, config_path: str) -> ConfigResult:
        check_file(Path(self.path) / self._normalize_file_name(config_path))
        return super().load_config(config_path)


Plugins.instance().register(Configurations)


def one_line(error: BaseException) -> str:
    """The message of an error on one line, without Hydra's search path and its hint on stack traces."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    text = printable(" ".join(lines[:100]) if lines else type(error).__name__)
    if repeated := re.match(r"Multiple values for (\S+)\. To override", text):
        return f"{repeated[1]} has a choice already; replace it with {repeated[1]}=NAME, without +"
    text = re.sub(r" Config search path:.*| Set the environment variable HYDRA_FULL_ERROR=1 .* stack trace\.", "", text)
    missing = error.__cause__
    if isinstance(missing, ConfigKeyError | ConfigAttributeError) and OmegaConf.is_dict(missing.parent_node):
        group = str(missing.full_key).removesuffix(str(missing.key))
        text += did_you_mean(str(missing.key), map(str, missing.parent_node), group)
    return text


@contextmanager
def hydra_errors() -> Iterator[None]:
    """Raise the errors of Hydra, OmegaConf and YAML as one-line UsageErrors."""
    try:
        yield
    except (HydraException, OmegaConfBaseException, YAMLError, UnicodeDecodeError) as error:
        raise UsageError(one_line(error)) from None
    except ValueError as error:
        if isinstance(error, UsageError) or not str(error).startswith("Config group override"):
            raise
        remedy = "a group takes the name of one of its files (noise=gaussian), a key its value (noise.level=0.01)"
        raise UsageError(f"{one_line(error)}: {remedy}") from None


@contextmanager
def configurations(overrides: Sequence[str] = ()) -> Iterator[None]:
    """Initialise Hydra on the package's configurations, and on those that ``hydra.searchpath`` of overrides adds.

    Whatever asks Hydra for the groups and choices of the overrides has to do it in here. See :func:`hydra_errors` for
    the errors.
    """
    with hydra_errors():
        added = _searched(overrides)
        if GlobalHydra.instance().is_initialized() and set(added) <= set(_ADDED.get()):
            yield
            return
        token, readers = _ADDED.set(added), SourcesRegistry.instance().types
        reader = readers[_Checked.scheme()]
        readers[_Checked.scheme()] = _Checked  # for as long as this lasts: workers of launchers get Hydra's own
        try:
            with initialize_config_module("nrsfm.conf", version_base="1.3", job_name="nrsfm"):
                yield
        finally:
            _ADDED.reset(token)
            readers[_Checked.scheme()] = reader


def _searched(overrides: Sequence[str]) -> tuple[str, ...]:
    """The value of the first ``hydra.searchpath``, which is the one that counts; () for none or no list."""
    first = [word for word in overrides if word.startswith("hydra.searchpath=")][:1]
    values = [override.value() for override in OverridesParser.create().parse_overrides(first)]
    return tuple(place for value in values if isinstance(value, list) for place in value if isinstance(place, str))


def quoted(text: str) -> str:
    """A text quoted for Hydra's override grammar."""
    return str(QuotedString(text, Quote.single).with_quotes())


def compose_config(overrides: Sequence[str] = ()) -> DictConfig:
    """Compose the configuration of ``nrsfm run`` with the same overrides."""
    with configurations(overrides):
        config: DictConfig = compose("config", overrides=list(overrides))
    return config


def data_folder() -> Path:
    """The folder of the real sequences that a run reads."""
    return Path(compose_config().data or "data").resolve()
