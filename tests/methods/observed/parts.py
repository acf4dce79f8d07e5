"""Scenes of the tests of cleaning."""

from __future__ import annotations

from nrsfm.datasets.registry import load_scene
from nrsfm.datasets.scene import Scene
from nrsfm.harness.config.compose import compose_config
from nrsfm.harness.config.settings import read


def load(name: str, *words: str) -> Scene:
    """The scene of ``dataset=NAME`` with overrides."""
    trial, settings = read(compose_config([f"dataset={name}", *words]))
    return load_scene(trial.dataset, settings.data)
