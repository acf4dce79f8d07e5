"""Completion of overrides by Hydra's engine, on the configurations of this package and of those installed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hydra.core.global_hydra import GlobalHydra
from hydra.errors import HydraException
from hydra.plugins.completion_plugin import DefaultCompletionPlugin
from hydra.types import RunMode
from omegaconf.errors import OmegaConfBaseException

from nrsfm.harness.config.compose import WORDS, configurations
from nrsfm.harness.config.plugins import choices

PARTS = "part"  # a group of which methods are made; no override of its own


def complete(before: Sequence[str], word: str) -> dict[str, str]:
    """What an override may become.

    Parameters
    ----------
    before : sequence of str
        The overrides that stand before it; those that cannot be used are passed over.
    word : str
        What is typed of it.

    Returns
    -------
    dict
        Words that begin as ``word`` does, each with a line that says what it is, or "".
    """
    key, sign, value = word.partition("=")
    listed = value.rpartition(",")[0]  # of a sweep: the choices before the last
    if sign and listed and "[" not in value:
        head = f"{key}={listed},"
        taken = set(listed.split(","))
        found = complete(before, f"{key}={value[len(listed) + 1 :]}")
        return {head + w[len(key) + 1 :]: text for w, text in found.items() if w[len(key) + 1 :] not in taken}
    if sign and key in WORDS:
        return {f"{key}={each}": "" for each in WORDS[key] if each.startswith(value)}
    name, path = DefaultCompletionPlugin._get_filename(word)
    if path is not None:
        paths = sorted(DefaultCompletionPlugin.complete_files(path))
        return {f"{name}{each}{'/' if Path(each).is_dir() else ''}": "" for each in paths}
    with configurations():
        engine = DefaultCompletionPlugin(GlobalHydra.instance().config_loader())
        for usable in (list(before), []):
            try:
                return _asked(engine, usable, word)
            except (HydraException, OmegaConfBaseException):
                continue
    return {}


def _asked(engine: DefaultCompletionPlugin, before: list[str], word: str) -> dict[str, str]:
    """The words of Hydra's engine, sorted; raises its errors if the overrides before make no configuration."""
    groups, exact = engine._query_config_groups(word, "config", before)
    if exact and groups:
        told = choices(word.partition("=")[0].lstrip("+~"))
        return {group: told.get(group.partition("=")[2], ("", ""))[0] for group in groups}
    config = engine.config_loader.load_configuration("config", overrides=before, run_mode=RunMode.MULTIRUN)
    chosen = config.hydra.runtime.choices
    found = _groups(groups, set(chosen))
    if not word.startswith("+"):
        found += engine._get_matches(config, word)
    now = {f"{group}=": f"now {choice}" for group, choice in chosen.items() if choice}
    return {each: now.get(each, "") for each in sorted(set(found))}


def _groups(found: Sequence[str], chosen: set[str]) -> list[str]:
    """Groups as they can be given: without a sign those that have a choice, with + the others."""
    kept = []
    for group in found:
        name = group.lstrip("+~").rstrip("=/")
        if name != PARTS and (name not in chosen if group.startswith("+") else name in chosen or group.endswith("/")):
            kept.append(group)
    return kept
