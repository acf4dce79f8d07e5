"""Hopkins155: its layout, on files written here and on the real ones, and the messages about broken files and names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from nrsfm.datasets import registry
from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.public import catalogue as sources
from nrsfm.datasets.real import hopkins
from nrsfm.datasets.real.hopkins import load_scene, path

F, P = 7, 12
LABELS = np.repeat([[2], [1], [3]], P // 3, axis=0)


def tracks() -> Array:
    """(F, 2, P)"""
    return np.random.default_rng(0).standard_normal((F, 2, P))


def write(folder: Path, scene: str = "arm", **changes: Any) -> Path:
    """A scene's file as the benchmark has it: x (3, P, F) with ones in the third row, s (P, 1) from 1 on."""
    W = tracks()
    x = np.array([[[W[f, axis, p] if axis < 2 else 1.0 for f in range(F)] for p in range(P)] for axis in range(3)])
    contents = {"x": x, "y": 100 * x, "s": LABELS, "frames": F, "points": P, **changes}
    file = folder / "hopkins155" / f"{scene}_truth.mat"
    file.parent.mkdir(exist_ok=True)
    scipy.io.savemat(file, {key: value for key, value in contents.items() if value is not None})
    return file


def complaint(folder: Path, scene: Any = "arm") -> str:
    with pytest.raises(DatasetError) as caught:
        load_scene(folder, scene)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_layout(tmp_path: Path) -> None:
    file = write(tmp_path)
    scene = load_scene(tmp_path, "arm")
    np.testing.assert_array_equal(scene.tracks, tracks())
    assert scene.tracks.flags.c_contiguous
    assert scene.labels is not None
    np.testing.assert_array_equal(scene.labels, LABELS.ravel() - 1)
    assert (scene.n_bodies, scene.n_frames, scene.n_points) == (3, F, P)
    assert scene.bodies == ("motion 1", "motion 2", "motion 3")
    assert scene.structure is None and scene.cameras is None and scene.visible is None
    assert scene.digest == sources.sha256(file)


def test_registry_knows_it(tmp_path: Path) -> None:
    settings = {"source": "hopkins155", "name": "hopkins155_arm", "scene": "arm"}
    file = write(tmp_path)
    assert registry.load_scene(settings, tmp_path).name == "arm"
    assert registry.digest(settings, tmp_path) == sources.sha256(file)
    file.unlink()
    for stand_in in (False, True):  # nothing takes its place
        with pytest.raises(MissingData, match="nrsfm data get hopkins155"):
            registry.digest(settings, tmp_path, stand_in)
        with pytest.raises(MissingData, match="nrsfm data get hopkins155"):
            registry.load_scene(settings, tmp_path, stand_in)


@pytest.mark.parametrize(
    "scene", ["", ".", "..", "../x", "/etc/passwd", "a/b", "a\0b", "arm\n", "ARM", "dancing", 1, None]
)
def test_names_that_are_none(tmp_path: Path, scene: Any) -> None:
    write(tmp_path, "dancing")
    assert "none of the 155" in complaint(tmp_path, scene)


@pytest.mark.parametrize(
    "x", [np.ones((2, P, F)), np.ones((3, P)), np.ones((3, F, P)), np.ones((3, P - 1, F)), np.ones((0, 0))]
)
def test_wrong_shape_of_the_tracks(tmp_path: Path, x: Array) -> None:
    file = write(tmp_path, x=x)
    assert f"{file}: x has shape {x.shape} and s {LABELS.shape}, wanted (3, P, F) and (P, 1)" in complaint(tmp_path)


@pytest.mark.parametrize("s", [LABELS.T, np.ones((P, 2)), np.ones((P - 1, 1)), np.zeros((0, 0))])
def test_wrong_shape_of_the_labels(tmp_path: Path, s: Array) -> None:
    write(tmp_path, s=s)
    assert f"and s {s.shape}" in complaint(tmp_path)


@pytest.mark.parametrize("s", [LABELS - 1, LABELS + 1, LABELS * 2, LABELS / 2, -LABELS, np.full((P, 1), np.nan)])
def test_labels_that_are_not_1_2_3(tmp_path: Path, s: Array) -> None:
    write(tmp_path, s=s)
    assert "field s does not hold the labels 1, 2, ..." in complaint(tmp_path)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_tracks_that_are_not_finite(tmp_path: Path, bad: float) -> None:
    x = np.ones((3, P, F))
    x[1, 4, 2] = bad
    write(tmp_path, x=x)
    text = complaint(tmp_path)
    assert "arm_truth.mat: field x" in text and "first: frame 2, point 4" in text


@pytest.mark.parametrize("field", ["x", "s"])
def test_missing_field(tmp_path: Path, field: str) -> None:
    change: dict[str, Any] = {field: None}
    write(tmp_path, **change)
    assert f"field {field} is missing" in complaint(tmp_path)


def test_damaged_file(tmp_path: Path, guarded: None) -> None:
    file = write(tmp_path)
    whole = file.read_bytes()
    for kept in (0, 100, 140, len(whole) // 2):
        file.write_bytes(whole[:kept])
        assert str(file) in complaint(tmp_path)


def test_155_scenes() -> None:
    assert (len(hopkins.SCENES), len(hopkins.TWO_MOTIONS), len(hopkins.THREE_MOTIONS)) == (155, 120, 35)
    assert sorted(hopkins.TWO_MOTIONS + hopkins.THREE_MOTIONS) == sorted(hopkins.SCENES)
    assert "dancing" not in hopkins.SCENES


def test_every_scene_is_in_the_catalogue(tmp_path: Path) -> None:
    contents = {file.path for file in sources.select(["hopkins155"])}
    assert contents == {f"hopkins155/{scene}_truth.mat" for scene in hopkins.SCENES}
    assert [file.url.rpartition("/Hopkins155/")[2] for file in sources.select(["1R2RC"])] == ["1R2RC/1R2RC_truth.mat"]


# The real files


@pytest.mark.data
def test_real_scenes_have_as_many_motions_as_their_names_say(data_folder: Path) -> None:
    for motions, scenes in ((2, hopkins.TWO_MOTIONS), (3, hopkins.THREE_MOTIONS)):
        for name in scenes:
            scene = load_scene(data_folder, name)
            assert scene.n_bodies == motions, name
            assert 15 <= scene.n_frames <= 100 and 39 <= scene.n_points <= 556


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "frames", "each"),
    [
        ("1R2RC", 29, (89, 121, 249)),
        ("cars9", 61, (44, 31, 145)),
        ("arm", 30, (45, 32)),
        ("three-cars", 15, (44, 48, 81)),
    ],
)
def test_real_scene_sizes(data_folder: Path, name: str, frames: int, each: tuple[int, ...]) -> None:
    scene = load_scene(data_folder, name)
    assert scene.labels is not None and scene.n_frames == frames
    assert tuple(np.bincount(scene.labels)) == each


@pytest.mark.data
@pytest.mark.parametrize("name", ["1R2RC_g12", "cars5", "people1"])
def test_real_tracks_are_the_pixels_in_other_units(data_folder: Path, name: str) -> None:
    """x = K^-1 y with one scale and offset an axis, the third coordinate 1."""
    stored = scipy.io.loadmat(path(data_folder, name))
    np.testing.assert_allclose(stored["x"][2], 1, atol=1e-12)
    W = load_scene(data_folder, name).tracks
    for axis in range(2):
        x, y = W[:, axis].ravel(), stored["y"][axis].T.ravel()
        assert np.corrcoef(x, y)[0, 1] == pytest.approx(1, abs=1e-6)
