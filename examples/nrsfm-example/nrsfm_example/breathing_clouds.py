"""BreathingClouds: two clouds of points that breathe, beside each other before one orbiting camera.

An example to start from. A source is two functions: ``load`` returns the scene, ``digest`` the identity of its data.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from nrsfm.datasets.body import Body
from nrsfm.datasets.composition import compose
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.scene import Scene

VERSION = "breathing_clouds 1"  # raise it whenever the numbers change, so that finished trials are run again


def load(settings: Mapping[str, Any], folder: Path) -> Scene:
    """The scene of the settings of conf/dataset/breathing_clouds.yaml.

    ``folder`` is the data folder. For a source that reads files, nrsfm.datasets.errors.existing raises MissingData if a
    file is not there. A scene of measured tracks is ``Scene(name=..., tracks=...)``, with the truth where it is known.
    """
    points, frames = settings["points"], settings["frames"]
    if not (isinstance(points, int) and isinstance(frames, int) and points >= 4 and frames >= 3):
        raise DatasetError(f"dataset.points is {points!r} and dataset.frames {frames!r}, wanted at least 4 and 3")
    rng = np.random.default_rng(settings["seed"])
    time = np.arange(frames)[:, None, None]
    bodies = []
    for name, period in (("slow", 60), ("fast", 25)):
        rest, swing = rng.standard_normal((2, 1, 3, points))
        structure = rest + 0.2 * np.sin(2 * np.pi * time / period) * swing
        bodies.append(Body(name, structure, digest=VERSION))
    return compose(bodies, name=settings["name"])


def digest(settings: Mapping[str, Any], folder: Path) -> str:
    """Identity of the data, without making the scene; for a file ``nrsfm.datasets.public.catalogue.sha256(path)``."""
    return VERSION
