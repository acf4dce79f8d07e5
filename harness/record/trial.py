"""A trial: the part of the configuration that decides its result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from nrsfm.harness.record.parameters import flatten

#: The groups of the configuration that make a trial.
GROUPS = ("dataset", "method", "cameras", "noise", "gaps", "corruption", "observations")
#: Those of them that are left out of a trial's identity where they are empty.
OPTIONAL = ("gaps", "corruption", "observations")

#: ``n_bodies`` where the method estimates the number of bodies.
AUTO = "auto"


def digest(value: Any) -> str:
    """A short, stable hash of plain data: SHA-256 of its canonical JSON, 16 hex digits."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def gap_words(gaps: Mapping[str, Any]) -> str:
    """Kind and share of a trial's gaps, as in ``random 0.2``; "" for none."""
    return f"{gaps['kind']} {gaps['share']:g}" if gaps else ""


def corruption_words(corruption: Mapping[str, Any]) -> str:
    """Kinds and amounts of a trial's corruption, as in ``outliers 0.05, smooth zoom 0.3``; "" for none."""
    names = {name: name for name in ("outliers", "jumps")} | {"zoom": f"{corruption.get('zooming')} zoom"}
    return ", ".join(f"{word} {corruption[name]:g}" for name, word in names.items() if corruption.get(name))


def observation_words(observations: Mapping[str, Any]) -> str:
    """How a trial's tracks are cleaned before the method, ``robust, scale``; "" for not at all."""
    return ", ".join(name for name in ("robust", "scale") if observations.get(name))


@dataclass(frozen=True)
class Trial:
    """One method on one scene under one setting: the resolved configuration, without paths.

    ``n_bodies`` is the number of clusters: None takes the scene's, ``auto`` leaves it to the method.
    """

    dataset: Mapping[str, Any]
    method: Mapping[str, Any]
    cameras: Mapping[str, Any]
    noise: Mapping[str, Any]
    gaps: Mapping[str, Any] = field(default_factory=dict)
    corruption: Mapping[str, Any] = field(default_factory=dict)
    observations: Mapping[str, Any] = field(default_factory=dict)
    n_bodies: int | str | None = None

    @property
    def setting(self) -> str:
        """Hash of the configuration alone, whatever the data and the code."""
        return digest({name: value for name, value in asdict(self).items() if name not in OPTIONAL or value})

    def key(self, data: str, version: str) -> str:
        """Hash of the setting, the digest of the data and the version of the method: the trial's identity."""
        return digest({"setting": self.setting, "data": data, "version": version})

    @property
    def title(self) -> str:
        """``dance_yoga ours``, followed by noise, gaps, bodies and cameras where they are not the defaults."""
        words = [str(self.dataset["name"]), str(self.method["name"])]
        if self.noise["level"]:
            words.append(f"noise={self.noise['level']:g}#{self.noise['repeat']}")
        if self.gaps:
            words.append(f"gaps={gap_words(self.gaps)}")
        words += [text for text in (corruption_words(self.corruption), observation_words(self.observations)) if text]
        if self.n_bodies is not None:
            words.append(f"n_bodies={self.n_bodies}")
        if self.cameras["source"] != "known":
            words.append(f"cameras={self.cameras['source']}")
        return " ".join(words)


def titles(trials: Sequence[Trial]) -> list[str]:
    """The title of each trial, followed by the settings in which the trials of one title differ."""
    alike: dict[str, list[dict[str, Any]]] = {}
    plain = [flatten(asdict(trial)) for trial in trials]
    for trial, settings in zip(trials, plain, strict=True):
        alike.setdefault(trial.title, []).append(settings)
    differing = {title: differing_keys(group) for title, group in alike.items()}
    return [
        " ".join([trial.title, *(f"{key}={settings[key]}" for key in differing[trial.title] if key in settings)])
        for trial, settings in zip(trials, plain, strict=True)
    ]


def differing_keys(settings: Sequence[Mapping[str, Any]]) -> list[str]:
    """The keys in which flat settings differ, in the order of the first that has them."""
    keys = dict.fromkeys(key for each in settings for key in each)
    return [key for key in keys if any(each.get(key) != settings[0].get(key) for each in settings)]
