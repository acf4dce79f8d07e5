"""The dense sequences, from files written here in their layout, and which points are neighbours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from scipy.spatial.distance import cdist

from nrsfm.datasets import registry
from nrsfm.datasets.body import Array, centre
from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.generated.surfaces import face
from nrsfm.datasets.readers.limits import LARGEST
from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.datasets.real import garg
from nrsfm.datasets.real.neighbours import even_choice, nearest_edges, on_pixels, pixel_edges

SETTINGS: dict[str, Any] = {
    "source": "garg",
    "name": "face1",
    "sequence": "face1",
    "points": 3275,
    "frames": None,
    "neighbours": 4,
    "fields": garg.FIELDS,
}


def write(file: Path, version: str, **fields: Array) -> None:
    """A MATLAB file of version 5 or 7.3, as MATLAB writes it: 7.3 is HDF5 behind 512 bytes, dimensions reversed."""
    file.parent.mkdir(exist_ok=True)
    if version == "5":
        scipy.io.savemat(file, fields)
        return
    with h5py.File(file, "w", userblock_size=512) as out:
        for name, value in fields.items():
            out.create_dataset(name, data=value.T).attrs["MATLAB_class"] = np.bytes_("double")
    with file.open("r+b") as out:
        out.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")


@pytest.fixture(scope="module")
def dense() -> tuple[Array, Array, Array]:
    """Structure (10, 3, 28880) in units of its own, cameras, and tracks (10, 2, 28880), whose origin is anywhere."""
    S = centre(face(28_880, 10, 3).structure)
    R = orbit(10, 7.0)
    return S, R, 250 * project(R, S) + 90


def stacked(tracks: Array) -> Array:
    """(2F, P): F rows of x, then F rows of y."""
    return tracks.transpose(1, 0, 2).reshape(-1, tracks.shape[2])


@pytest.mark.parametrize(
    ("version", "blocks"), [("5", False), ("7.3", True)], ids=["5, rows xyz a frame", "7.3, blocks of x, y, z"]
)
def test_a_synthetic_face_is_read_whole(
    tmp_path: Path, dense: tuple[Array, Array, Array], version: str, blocks: bool
) -> None:
    S, R, W = dense
    truth = S.transpose(1, 0, 2) if blocks else S
    write(tmp_path / "garg" / "face1.mat", version, W=stacked(W), S=truth.reshape(-1, S.shape[2]))
    scene = registry.load_scene(SETTINGS | {"points": None}, tmp_path)
    assert scene.tracks.shape == (10, 2, 28_880) and scene.name == "face1" and scene.n_bodies == 1
    assert scene.structure is not None and scene.cameras is not None and not scene.stand_in
    np.testing.assert_allclose(scene.cameras, R, atol=1e-9)
    np.testing.assert_allclose(scene.structure, 250 * S, atol=1e-6)
    np.testing.assert_allclose(project(scene.cameras, scene.structure), scene.tracks, atol=1e-6)
    few = registry.load_scene(SETTINGS | {"points": 300, "frames": 4}, tmp_path)
    assert few.tracks.shape == (4, 2, 300) and few.structure is not None
    assert few.cameras is not None
    np.testing.assert_allclose(project(few.cameras, few.structure), few.tracks, atol=1e-6)
    assert registry.digest(SETTINGS, tmp_path) == scene.digest


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_a_real_sequence_has_tracks_alone(tmp_path: Path, version: str) -> None:
    rows, columns = np.mgrid[10:16, 5:12]
    first = np.stack([columns.ravel(), rows.ravel()]).astype(float)
    tracks = np.stack([first, first + 0.3, first * 1.01])
    write(tmp_path / "garg" / "heart.mat", version, W=stacked(tracks))
    settings = SETTINGS | {"sequence": "heart", "name": "heart", "points": None}
    scene = registry.load_scene(settings, tmp_path)
    np.testing.assert_allclose(scene.tracks, centre(tracks), atol=1e-12)
    assert scene.structure is None and scene.cameras is None
    assert len(scene.edges) == 6 * 6 + 5 * 7, "the pixel grid of the first image"
    assert len(registry.load_scene(settings | {"points": 20}, tmp_path).edges) > 20, "few points: the nearest ones"


def test_an_absent_sequence_is_not_filled(tmp_path: Path) -> None:
    for read in (registry.load_scene, registry.digest):
        with pytest.raises(MissingData, match=r"face1\.mat is not there"):
            read(SETTINGS, tmp_path, True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sequence": "face5"}, "dataset.sequence is 'face5'"),
        ({"points": 1}, "dataset.points is 1"),
        ({"points": 10**9}, "dataset.points"),
        ({"points": 2.5}, "dataset.points"),
        ({"frames": 11}, "dataset.frames is 11"),
        ({"neighbours": 0}, "dataset.neighbours"),
        ({"fields": {"tracks": "U"}}, r"field U is missing \(the file holds S, double"),
    ],
)
def test_wrong_settings_are_named(
    tmp_path: Path, dense: tuple[Array, Array, Array], changes: dict[str, object], message: str
) -> None:
    S, _, W = dense
    write(tmp_path / "garg" / "face1.mat", "7.3", W=stacked(W), S=S.reshape(30, -1))
    with pytest.raises(DatasetError, match=message):
        registry.load_scene(SETTINGS | changes, tmp_path)


def test_wrong_fields_are_named(tmp_path: Path, dense: tuple[Array, Array, Array], rng: np.random.Generator) -> None:
    S, _, W = dense
    file, S = tmp_path / "garg" / "face2.mat", S.reshape(30, -1)
    for fields, message in (
        ({"W": stacked(W)[:, :50], "S": S}, r"W has shape \(20, 50\), wanted \(20, 28880\)"),
        ({"W": stacked(W), "S": S[:29]}, r"S has shape \(29, 28880\), wanted \(30, 28880\)"),
        ({"W": stacked(W), "S": rng.standard_normal(S.shape)}, "unexplained by any orthographic camera"),
        ({"W": stacked(W), "S": np.where(S > 0.05, np.nan, S)}, "S holds NaN"),
    ):
        write(file, "5", **fields)
        with pytest.raises(DatasetError, match=message):
            registry.load_scene(SETTINGS | {"sequence": "face2"}, tmp_path)


# MATLAB 7.3 from strangers


def test_a_73_file_leads_nowhere_else(tmp_path: Path) -> None:
    other, file = tmp_path / "other.h5", tmp_path / "a.mat"
    with h5py.File(other, "w") as out:
        out["secret"] = np.ones(3)
    with h5py.File(file, "w") as out:
        out["link"] = h5py.ExternalLink(str(other), "secret")
        out["soft"] = h5py.SoftLink("/none")
        out.create_group("struct")
        out.create_dataset("text", data=np.ones((1, 3), "u2")).attrs["MATLAB_class"] = np.bytes_("char")
        out.create_dataset("vast", shape=(LARGEST, 9), dtype="f8", chunks=(1024, 9)).attrs["MATLAB_class"] = np.bytes_(
            "double"
        )
        out.create_dataset("outside", (4,), "f8", external=[(str(other), 0, 32)])
    for name, message in (
        ("link", "not stored in the file itself"),
        ("soft", "not stored in the file itself"),
        ("struct", "struct or cell"),
        ("text", "of type char"),
        ("vast", "claims 144 GiB"),
        ("outside", "not stored in the file itself"),
        ("gone", r"field gone is missing \(the file holds link, "),
    ):
        with pytest.raises(DatasetError, match=message):
            read_mat(file, [name])


def test_damaged_73_files_end_in_one_line(tmp_path: Path, rng: np.random.Generator) -> None:
    file = tmp_path / "a.mat"
    write(file, "7.3", W=rng.standard_normal((20, 50)), S=rng.standard_normal((30, 50)))
    whole = file.read_bytes()
    for _ in range(12):
        raw = bytearray(whole)
        for at in rng.integers(520, len(raw), 12):
            raw[at] = rng.integers(256)
        file.write_bytes(bytes(raw[: rng.integers(600, len(raw))] if rng.random() < 0.3 else raw))
        try:
            read_mat(file, ["W", "S"])
        except DatasetError as error:
            assert "\n" not in str(error) and str(file) in str(error)


# Neighbours


def test_pixel_neighbours_agree_with_distances(rng: np.random.Generator) -> None:
    pixels = rng.permutation(np.argwhere(rng.random((17, 23)) < 0.7) - [5, 40])
    wanted = np.argwhere(np.triu(np.abs(cdist(pixels, pixels, "cityblock") - 1) < 1e-9))
    pairs = np.unique(np.sort(pixel_edges(pixels), axis=1), axis=0)
    np.testing.assert_array_equal(pairs, wanted)
    assert len(pixel_edges(pixels)) == len(wanted), "each once"


def test_only_points_on_pixels_of_their_own_have_a_grid() -> None:
    grid = np.array([[1.0, 2, 5], [1, 1, 7]])
    np.testing.assert_array_equal(on_pixels(grid), grid.T)
    assert on_pixels(grid + 0.25) is None
    assert on_pixels(np.array([[1.0, 1], [2, 2]])) is None


def test_nearest_neighbours_agree_with_distances(rng: np.random.Generator) -> None:
    points = rng.standard_normal((2, 60))
    near = np.argsort(cdist(points.T, points.T), axis=1)[:, 1:5]
    wanted = {tuple(sorted((i, int(j)))) for i in range(60) for j in near[i]}
    pairs = nearest_edges(points, 4)
    assert set(map(tuple, pairs.tolist())) == wanted and len(pairs) == len(wanted)
    assert len(nearest_edges(points[:, :3], 10)) == 3


def test_an_even_choice_leaves_no_hole(rng: np.random.Generator) -> None:
    """No pixel is far from a chosen one, as far as the area that each stands for."""
    rows, columns = np.mgrid[:190, :152]
    points = np.stack([columns.ravel(), rows.ravel()]).astype(float)
    chosen = even_choice(points, 3275)
    assert len(np.unique(chosen)) == 3275 and (np.diff(chosen) > 0).all()
    side = np.sqrt(points.shape[1] / 3275)
    gaps = cdist(points[:, ::7].T, points[:, chosen].T).min(axis=1)
    assert gaps.max() < 1.7 * side
    np.testing.assert_array_equal(even_choice(points, None), np.arange(points.shape[1]))
    np.testing.assert_array_equal(even_choice(points, points.shape[1]), np.arange(points.shape[1]))
