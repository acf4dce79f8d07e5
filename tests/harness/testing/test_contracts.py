"""The contract over every method and every dataset of the configuration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nrsfm.datasets import ENTRY_POINTS
from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.generated import procedural
from nrsfm.datasets.scene import Scene
from nrsfm.harness.config.plugins import choices
from nrsfm.harness.testing import Check, check_dataset, check_method, parametrize_with_checks
from nrsfm.methods.base import Labels, Method, MethodError, Observations, Reconstruction, check_bodies, standardise
from tests.methods.parts import present

#: Further overrides of choices that cannot do without.
MORE = {"c3d": " dataset.take=cmu_02_01"}


@parametrize_with_checks(*(f"method={name}" for name, (_, package) in choices("method").items() if not package))
def test_methods(check: Check) -> None:
    check()


@parametrize_with_checks(
    *(
        f"dataset={name}{MORE.get(name, '')}"
        for name, (_, package) in choices("dataset").items()
        if not package and name != "tracks"
    )
)
def test_datasets(check: Check) -> None:
    check()


def test_tracks_of_ones_own(tmp_path: Path) -> None:
    scene = procedural.load_scene(["person", "face"], 8, 12, 0, name="mine", placement="paper")
    np.savez(tmp_path / "mine.npz", tracks=scene.tracks, cameras=present(scene.cameras), labels=present(scene.labels))
    check_dataset({"source": "tracks", "name": "mine", "file": "mine.npz"}, tmp_path)


class Middle(Method):
    """Splits the tracks at the mean of x; keeps the contract, or breaks it in one way."""

    provides = frozenset({"labels", "structure"})
    handles_gaps = True

    def __init__(self, fault: str = "") -> None:
        self.fault = fault + "s" * fault.startswith("constructor")

    def reconstruct(self, observations: Observations, n_bodies: int | None) -> Reconstruction:
        tracks = observations.tracks
        if self.fault == "wrong error" and n_bodies == 0:
            raise IndexError("too few")
        if self.fault == "two lines" and n_bodies == 0:
            raise MethodError("two\nlines")
        data = standardise(tracks, observations.visible)
        cameras = observations.required_cameras() if self.fault != "no cameras" else np.tile(np.eye(2, 3), (30, 1, 1))
        if self.fault != "any number":
            check_bodies(n_bodies, tracks.shape[2])
        W = data.W.copy()
        if self.fault == "unseeded":
            W += 1e-3 * np.random.standard_normal(W.shape)  # noqa: NPY002
        if self.fault == "writes":
            tracks[0] = 0
        if self.fault == "remembers":
            self.fault = "remembered"
        labels: Labels | None = (W[:, 0].mean(axis=0) > 0).astype(np.int64)
        if self.fault == "order":
            labels = np.arange(tracks.shape[2]) % 2
        if self.fault == "labels from 1":
            labels = 1 + (W[:, 0].mean(axis=0) > 0).astype(np.int64)
        W -= W.mean(axis=2, keepdims=True)
        structure = cameras.transpose(0, 2, 1) @ W * data.scale
        if self.fault == "not centred":
            structure = structure + 1
        if self.fault == "silent":
            labels = None
        if self.fault == "gap" and observations.visible is not None:
            structure[0, 0, 0] = np.nan
        return Reconstruction(labels=labels, structure=structure, cameras=cameras)

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float:
        return -1.0 if self.fault == "memory" else 8.0 * 3 * n_frames * n_points


class Unnamed(Middle):
    """Computes more than ``provides`` names."""

    provides = frozenset({"labels"})


def test_a_method_that_keeps_the_contract_passes() -> None:
    check_method(Middle())


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("constructor", "the constructor changes an argument"),
        ("wrong error", "IndexError"),
        ("two lines", "one line"),
        ("any number", "more bodies than tracks are not refused"),
        ("no cameras", "tracks without cameras are not refused"),
        ("unseeded", "a second run on the same input"),
        ("writes", "writes into its tracks"),
        ("remembers", "changes the hyper-parameters"),
        ("order", "order"),
        ("labels from 1", "labels run from"),
        ("not centred", "off its centre"),
        ("silent", "labels"),
        ("gap", "NaN"),
        ("memory", "forecasts"),
    ],
)
def test_a_method_that_breaks_the_contract_is_named_with_its_fault(fault: str, message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_method(Middle(fault))


def test_a_part_that_provides_does_not_name_is_a_fault() -> None:
    with pytest.raises(AssertionError, match="does not name structure, which is present"):
        check_method(Unnamed())


def faulty(settings: Mapping[str, Any], folder: Path, _stand_in: bool) -> Scene:
    """A scene of four points, right or with one fault."""
    fault = settings["fault"]
    if fault == "file" and not folder.name.startswith("data"):
        raise KeyError("file")
    rng = np.random.default_rng(None if fault == "unseeded" else 0)
    structure = rng.standard_normal((6, 3, 4))
    if fault != "off":
        structure -= structure.mean(axis=2, keepdims=True)
    cameras = orbit(6)
    tracks = project(cameras, structure)
    if fault == "camera":
        cameras = cameras[:, ::-1].copy()
    return Scene(
        name="a scene" if fault == "name" else "scene",
        tracks=tracks,
        structure=structure,
        cameras=cameras,
        labels=np.array([0, 0, 1, 2 if fault == "label" else 1]) * (2 if fault == "gap" else 1),
        bodies=("a", "b"),
        edges=np.array([[0, 4 if fault == "edge" else 3]]),
    )


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("", ""),
        ("unseeded", "seed what is drawn"),
        ("off", "off its centre"),
        ("camera", "off the tracks"),
        ("name", "named 'a scene'"),
        ("label", "2 names for 3 bodies"),
        ("gap", "wanted 0, 1"),
        ("edge", "outside 0..3"),
        ("file", "wanted MissingData"),
        ("two lines", "wanted one line"),
        ("digest", "in another process"),
    ],
)
def test_a_dataset_that_breaks_the_contract_is_named_with_its_fault(
    fault: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "data"
    monkeypatch.syspath_prepend(str(tmp_path))
    module = tmp_path / "faulty_source.py"
    module.write_text(
        "from tests.harness.testing.test_contracts import faulty\n"
        "def load(settings, folder):\n    return faulty(settings, folder, False)\n"
        "def digest(settings, folder):\n"
        "    return {'two lines': 'a\\nb', 'digest': str(hash('a'))}.get(settings['fault'], 'v1')\n"
    )
    info = tmp_path / "faulty-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: faulty\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{ENTRY_POINTS}]\nfaulty = faulty_source\n")
    settings = {"name": "scene", "source": "faulty", "fault": fault}
    if not fault:
        check_dataset(settings, folder)
        return
    with pytest.raises(AssertionError, match=message):
        check_dataset(settings, folder)


def test_only_methods_and_datasets_have_a_contract() -> None:
    with pytest.raises(ValueError, match="cameras=known"):
        parametrize_with_checks("cameras=known")
