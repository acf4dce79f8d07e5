"""Completion of overrides by Hydra's engine, on the configurations of this package and of installed packages."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hydra.core.global_hydra import GlobalHydra
from hydra.errors import HydraException
from hydra.plugins.completion_plugin import DefaultCompletionPlugin
from hydra.types import RunMode
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from nrsfm.harness.config.compose import WORDS, configurations
from nrsfm.harness.config.plugins import choices

PARTS = "part"  # a group that methods are composed of; it is no override


def complete(before: Sequence[str], word: str) -> dict[str, str]:
    """Overrides that begin with ``word``, each with an explanation or "", keys before groups.

    ``before`` are the overrides that precede it on the command line; they are ignored if they cannot be composed.
    """
    key, sign, value = word.partition("=")
    listed, comma, last = value.rpartition(",")  # of a sweep: the choices before the last
    if comma and "[" not in value:
        head = f"{key}={listed},"
        added = {head + w.partition("=")[2]: text for w, text in complete(before, f"{key}={last}").items()}
        return {w: text for w, text in added.items() if w.removeprefix(head) not in listed.split(",")}
    if sign and key in WORDS:
        return {f"{key}={each}": "" for each in WORDS[key] if each.startswith(value)}
    name, path = DefaultCompletionPlugin._get_filename(word)
    if path is not None:
        paths = sorted(DefaultCompletionPlugin.complete_files(path))
        return {f"{name}{each}{'/' if Path(each).is_dir() else ''}": "" for each in paths}
    with configurations(before):
        for usable in (list(before), []):
            try:
                words = _engine_words(usable, word)
            except (HydraException, OmegaConfBaseException):
                continue
            if len(words) == 1 and (only := next(iter(words))).endswith(".") and only != word:
                return complete(before, only)  # a shell would put a space behind the only word
            return words
    return {}


def _engine_words(before: list[str], word: str) -> dict[str, str]:
    """The words of Hydra's engine; raises its errors if the overrides before cannot be composed."""
    engine = DefaultCompletionPlugin(GlobalHydra.instance().config_loader())
    groups, exact = engine._query_config_groups(word, "config", before)
    if exact and groups:
        explained = choices(word.partition("=")[0].lstrip("+~"))
        return {group: explained.get(group.partition("=")[2], ("", ""))[0] for group in groups}
    config = engine.config_loader.load_configuration("config", overrides=before, run_mode=RunMode.MULTIRUN)
    chosen = config.hydra.runtime.choices
    words = {group for group in groups if _is_usable(group, chosen)}
    if not word.startswith("+"):
        for key in engine._get_matches(config, word):
            is_list = key.endswith(".") and OmegaConf.is_list(OmegaConf.select(config, key[:-1]))
            if not ("=" in word and key.endswith("=")):  # items of a list
                words.add(f"{key[:-1]}=" if is_list else key)
    now = {f"{group}=": f"now {choice}" for group, choice in chosen.items() if choice}
    return {each: now.get(each, "") for each in sorted(words, key=lambda each: (each.endswith("."), each))}


def _is_usable(group: str, chosen: dict[str, str]) -> bool:
    """Whether Hydra accepts a group as it is written: without a sign if it has a choice, with + if it has none."""
    name = group.lstrip("+~").rstrip("=/")
    return name != PARTS and (name not in chosen if group[0] == "+" else name in chosen or group.endswith("/"))
