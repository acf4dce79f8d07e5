"""The contract of a dataset: a consistent scene, the same every time, and data with a digest."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from copy import deepcopy
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from nrsfm.datasets.body import centre, spread
from nrsfm.datasets.errors import MissingData
from nrsfm.datasets.registry import digest, load_scene
from nrsfm.datasets.scene import Scene
from nrsfm.harness.config.schema import NAME

ALIKE = ("tracks", "labels", "structure", "cameras", "visible", "edges")

DIGEST = """
import json, sys
from pathlib import Path
from nrsfm.datasets.registry import digest
settings, folder = json.loads(sys.stdin.read())
print(digest(settings, Path(folder)))
"""


class Subject:
    """A dataset under test: settings and data folder as :func:`nrsfm.datasets.registry.load_scene` takes them."""

    def __init__(self, settings: Mapping[str, Any], folder: Path) -> None:
        self.settings = settings
        self.folder = folder

    @property
    def name(self) -> str:
        return str(self.settings.get("name") or self.settings.get("source"))

    @cached_property
    def scene(self) -> Scene:
        return load_scene(self.settings, self.folder)


def check_scene(subject: Subject) -> None:
    """Labels count from 0 and bodies have names; edges join existing tracks; the structure is centred."""
    scene, name = subject.scene, subject.name
    assert re.fullmatch(NAME, scene.name), f"{name}: the scene is named {scene.name!r}"
    if scene.labels is not None:
        whole = np.array_equal(np.unique(scene.labels), np.arange(scene.n_bodies or 0))
        assert whole and np.issubdtype(scene.labels.dtype, np.integer), (
            f"{name}: labels are {np.unique(scene.labels)}, wanted 0, 1, ..."
        )
        assert not scene.bodies or len(scene.bodies) == scene.n_bodies, (
            f"{name}: {len(scene.bodies)} names for {scene.n_bodies} bodies"
        )
    edges = scene.edges
    assert edges.ndim == 2 and edges.shape[1] == 2, f"{name}: edges have shape {edges.shape}, wanted (E, 2)"
    inside = edges.size == 0 or (edges.min() >= 0 and edges.max() < scene.n_points)
    assert inside, f"{name}: edges name tracks outside 0..{scene.n_points - 1}"
    assert all(seen(scene.tracks)), f"{name}: a track is never seen, or a frame shows none"
    if scene.structure is not None:
        off = np.abs(np.nanmean(scene.structure, axis=2)).max() / spread(scene.structure)
        assert off < 1e-6, f"{name}: the structure is off its centre by {off:.1e} of its spread"


def check_cameras(subject: Subject) -> None:
    """Where both are known, the structure projects onto the tracks, up to a translation of each frame."""
    scene = subject.scene
    if scene.cameras is None or scene.structure is None:
        return
    off = centre(scene.tracks - scene.cameras @ scene.structure)
    share = float(np.sqrt(np.nanmean(off**2))) / spread(scene.tracks)
    assert share < 0.1, f"{subject.name}: the cameras see the structure off the tracks by {share:.0%} of their spread"


def check_determinism(subject: Subject) -> None:
    """The same settings make the same scene, whatever the global random generator's state, and are not changed."""
    settings = deepcopy(dict(subject.settings))
    before = np.random.get_state()  # noqa: NPY002 - the generator of unseeded code
    try:
        np.random.seed(1)  # noqa: NPY002
        again = load_scene(settings, subject.folder)
    finally:
        np.random.set_state(before)  # noqa: NPY002
    assert settings == dict(subject.settings), f"{subject.name}: loading the scene changes its settings"
    for part in ALIKE:
        one, other = getattr(subject.scene, part), getattr(again, part)
        same = (one is None and other is None) or np.array_equal(one, other, equal_nan=part != "edges")
        assert same, f"{subject.name}: loaded again, the {part} differ; seed what is drawn"


def check_digest(subject: Subject) -> None:
    """The digest of the data is one line, the same before and after loading and in another process."""
    _ = subject.scene
    here = digest(subject.settings, subject.folder)
    assert here.strip() == here != "" and "\n" not in here, f"{subject.name}: digest is {here!r}, wanted one line"
    request = json.dumps([dict(subject.settings), str(subject.folder.resolve())])
    environment = {**os.environ, "PYTHONHASHSEED": "7", "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", DIGEST], input=request, env=environment, capture_output=True, text=True, check=False
    )
    there = done.stdout.rstrip("\n") or done.stderr
    assert there == here, f"{subject.name}: digest is {here!r} here and {there!r} in another process"


def check_absent_files(subject: Subject) -> None:
    """Without its files a dataset raises MissingData, in one line; a generated one needs no files."""
    _ = subject.scene
    with tempfile.TemporaryDirectory() as folder:
        for part in (digest, load_scene):
            try:
                _ = part(subject.settings, Path(folder))
            except MissingData as error:
                assert "\n" not in str(error), f"{subject.name}: MissingData says {str(error)!r}, wanted one line"
            except Exception as error:
                raise AssertionError(
                    f"{subject.name}: {type(error).__name__} ({error}) without files, wanted MissingData"
                ) from error


CHECKS: tuple[Callable[[Subject], None], ...] = (
    check_scene,
    check_cameras,
    check_determinism,
    check_digest,
    check_absent_files,
)


def seen(tracks: np.ndarray) -> tuple[bool, bool]:
    """Whether every track is visible in some frame, and every frame shows some track; (F, 2, P), NaN where hidden."""
    visible = np.isfinite(tracks).all(axis=1)
    return bool(visible.any(axis=0).all()), bool(visible.any(axis=1).all())
