"""Arrays as trackers write them: each layout gives the same tracks, and what is not clear is refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io

from nrsfm.datasets.cameras import orbit
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.generated import procedural
from nrsfm.datasets.readers.axes import arranged, orders
from nrsfm.datasets.readers.trackfields import read_fields
from nrsfm.datasets.readers.trackfile import RECOGNISED, Asked, TrackFile
from tests.fuzz import files

F, P = 20, 12


@pytest.fixture
def tracks() -> np.ndarray:
    """Points that turn before a camera, in pixels, (F, 2, P)."""
    shape = np.random.default_rng(0).standard_normal((3, P))
    return np.asarray(80 * orbit(F, 3.0) @ shape + np.array([[400.0], [300.0]]))


@pytest.fixture
def visible() -> np.ndarray:
    return np.random.default_rng(1).random((F, P)) > 0.2


def save(path: Path, **arrays: Any) -> Path:
    np.savez(path / "a.npz", **arrays)
    return path / "a.npz"


def hidden(tracks: np.ndarray, visible: np.ndarray) -> np.ndarray:
    return np.where(visible[:, None], tracks, np.nan)


def refused(path: Path, *words: str, asked: Asked = RECOGNISED) -> None:
    with pytest.raises(DatasetError) as caught:
        read_fields(path, asked)
    line = str(caught.value)
    assert all(word in line for word in words), line
    assert path.name in line and line.isprintable() and len(line) < 500 + len(str(path))


def cotracker(path: Path, W: np.ndarray, V: np.ndarray) -> Path:
    """``pred_tracks, pred_visibility = model(video)``: (B, T, N, 2) and (B, T, N, 1)."""
    return save(path, pred_tracks=W.transpose(0, 2, 1)[None].astype("f4"), pred_visibility=V[None, :, :, None])


def cotracker_renamed(path: Path, W: np.ndarray, V: np.ndarray) -> Path:
    return save(path, tracks=W.transpose(0, 2, 1).astype("f4"), visibility=V)


def cotracker3(path: Path, W: np.ndarray, V: np.ndarray) -> Path:
    """Visibility and confidence as probabilities."""
    likely = np.where(V, 0.9, 0.2)
    return save(path, pred_tracks=W.transpose(0, 2, 1)[None].astype("f4"), pred_visibility=likely[None])


def tapir(path: Path, W: np.ndarray, V: np.ndarray) -> Path:
    """``tracks`` (N, T, 2), ``visibles`` (N, T)."""
    return save(path, tracks=W.transpose(2, 0, 1).astype("f4"), visibles=V.T, expected_dist=np.zeros((P, F)))


def tapir_logits(path: Path, W: np.ndarray, V: np.ndarray) -> Path:
    """The raw output: the occlusion's logits, with a batch's axis."""
    return save(path, tracks=W.transpose(2, 0, 1)[None].astype("f4"), occlusion=np.where(V, -3.0, 2.5).T[None])


def tapvid(path: Path, W: np.ndarray, V: np.ndarray) -> Path:
    """The annotations of TAP-Vid: ``points`` (N, T, 2), ``occluded`` (N, T)."""
    return save(path, points=W.transpose(2, 0, 1).astype("f4"), occluded=~V.T)


def sleap(path: Path, W: np.ndarray, V: np.ndarray) -> Path:
    """SLEAP's analysis file: two animals of six nodes."""
    with h5py.File(path / "a.h5", "w") as file:
        held = hidden(W, V).reshape(F, 2, 2, 6).transpose(2, 1, 3, 0)
        file.create_dataset("tracks", data=held, compression="gzip")
        file["node_names"] = [f"n{k}" for k in range(6)]
        file["track_names"] = np.array([b"left", b"right"])
        file["track_occupancy"] = np.ones((F, 2), dtype=np.uint8)
        file["point_scores"] = np.ones((2, 6, F))
        file["provenance"] = "{}"
    return path / "a.h5"


@pytest.mark.parametrize(
    "write",
    [cotracker, cotracker_renamed, cotracker3, tapir, tapir_logits, tapvid, sleap],
    ids=lambda write: write.__name__,
)
def test_what_trackers_write(
    write: Callable[..., Path], tracks: np.ndarray, visible: np.ndarray, tmp_path: Path
) -> None:
    read = read_fields(write(tmp_path, tracks, visible))
    np.testing.assert_allclose(read.tracks, hidden(tracks, visible), rtol=1e-6)
    assert read.notes and (read.image or write is cotracker_renamed)
    assert ("confidence" in str(read.notes)) == (write is cotracker3)
    if write is sleap:
        assert read.ids[0] == "left.n0" and read.bodies == ("left", "right")
        np.testing.assert_array_equal(read.labels, np.arange(P) // 6)
        assert read.notes[1] == "not used: fields point_scores, provenance, track_occupancy"


def test_one_array_alone(tracks: np.ndarray, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", tracks.transpose(0, 2, 1)[None])
    read = read_fields(tmp_path / "a.npy")
    np.testing.assert_array_equal(read.tracks, tracks)
    assert "with the axes F,P,2" in read.notes[0]
    np.savez(tmp_path / "b.npz", tracks.transpose(2, 0, 1))  # goes by the name arr_0
    np.testing.assert_array_equal(read_fields(tmp_path / "b.npz").tracks, tracks)


def laid_out(tracks: np.ndarray, axes: str) -> np.ndarray:
    """The array of such axes, made without the code under test."""
    letters = axes.replace(",", "")
    array = tracks.transpose(["F2P".index(letter) for letter in letters])
    if axes.count(",") == 2:
        return array
    a, b, c = array.shape
    return array.reshape(a * b, c) if axes.index(",") == 2 else array.reshape(a, b * c)


ALL = [
    *(",".join(letters) for letters in permutations("F2P")),
    "F2,P", "2F,P", "P2,F", "2P,F", "F,P2", "F,2P", "P,F2", "P,2F",
]  # fmt: skip


FLAT, TURNED = ("F,2P", "F,P2"), ("2P,F", "P2,F")  # how x and y alternate within a frame does not show


@pytest.mark.parametrize("axes", ALL)
def test_every_order_of_axes_is_recognised(axes: str, tracks: np.ndarray, tmp_path: Path) -> None:
    array = laid_out(tracks, axes)
    assert axes in orders(array.shape)
    np.testing.assert_array_equal(arranged(array, axes), tracks)
    path = save(tmp_path, W=array)
    if axes in (*FLAT, *TURNED):
        refused(path, f"one of {' '.join(FLAT if axes in FLAT else TURNED)} (F frames")
        read = read_fields(path, Asked(axes=axes))
        np.testing.assert_array_equal(read.tracks, tracks)
        return
    read = read_fields(path)
    np.testing.assert_array_equal(read.tracks, tracks)
    assert read.notes == () or f"with the axes {axes} " in read.notes[0]
    assert (read.notes == ()) == (axes in ("F,2,P", "F2,P"))


@pytest.mark.parametrize("bodies", [["person", "face"], ["person", "person"]])
@pytest.mark.parametrize("axes", ["F2,P", "2F,P", "P,F2", "F,P,2", "P,F,2"])
def test_generated_scenes_are_read_right(bodies: list[str], axes: str, tmp_path: Path) -> None:
    W = procedural.load_scene(bodies, 20, 60, 0, name="two", placement="paper").tracks
    np.testing.assert_array_equal(read_fields(save(tmp_path, W=laid_out(W, axes))).tracks, W)


def test_what_the_numbers_do_not_tell_is_asked(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).standard_normal((F, P, 2))
    path = save(tmp_path, tracks=noise)
    refused(path, "do not say which axis is time", "one of F,P,2 P,F,2")
    for axes in ("F,P,2", "P,F,2"):
        read = read_fields(path, Asked(axes=axes))
        np.testing.assert_array_equal(read.tracks, noise.transpose(*{"F": (0, 2, 1), "P": (1, 2, 0)}[axes[0]]))
    refused(path, "--axes 'F,2,P' does not fit", asked=Asked(axes="F,2,P"))
    documented = noise.reshape(F, 2, P)
    np.testing.assert_array_equal(read_fields(save(tmp_path, tracks=documented)).tracks, documented)


def test_fields_of_other_names(tracks: np.ndarray, visible: np.ndarray, tmp_path: Path) -> None:
    path = save(tmp_path, xy=tracks, seen=visible, fps=25.0)
    refused(path, "it holds no tracks", "xy, float64 (20, 2, 12)", "fps, float64 ()", "--columns tracks=NAME")
    read = read_fields(path, Asked(columns={"tracks": "xy", "visible": "seen"}))
    np.testing.assert_array_equal(read.tracks, hidden(tracks, visible))
    assert read.notes[-1] == "not used: field fps"
    refused(path, "there is no field 'uv' for tracks", asked=Asked(columns={"tracks": "uv"}))


def test_confidence_is_weighed(tracks: np.ndarray, tmp_path: Path) -> None:
    sure = np.random.default_rng(0).random((F, P))
    path = save(tmp_path, tracks=tracks, confidence=sure)
    np.testing.assert_array_equal(read_fields(path).tracks, hidden(tracks, sure >= 0.5))
    np.testing.assert_array_equal(read_fields(path, Asked(confidence=0.9)).tracks, hidden(tracks, sure >= 0.9))


def objects(path: Path, W: np.ndarray) -> Path:
    fields = files.opaque5("title", "string"), files.matrix_of("W", W.reshape(-1, P)), files.opaque5("T", "table")
    (path / "a.mat").write_bytes(files.mat5(files.opaque5("visible", "string"), *fields, files.hidden5()))
    return path / "a.mat"


def test_objects_of_matlab_are_passed_over(tracks: np.ndarray, tmp_path: Path) -> None:
    path = objects(tmp_path, tracks)
    refused(path, "field visible is of type string, wanted numbers")
    path.write_bytes(path.read_bytes().replace(b"visible", b"invalid"))
    read = read_fields(path)
    np.testing.assert_array_equal(read.tracks, tracks)
    assert read.notes == ("not used: fields invalid, title, T",)
    refused(path, "field T is of type table", asked=Asked(columns={"tracks": "T"}))


def test_what_a_mat_file_holds_is_listed(tracks: np.ndarray, tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"xy": tracks, "who": "me", "more": {"a": 1.0}})
    refused(tmp_path / "a.mat", "the file holds xy, double (20, 2, 12); who, char (1, 2); more, struct (1, 1)")


def test_sleap_of_one_animal(tracks: np.ndarray, tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["tracks"], file["node_names"] = tracks.transpose(1, 2, 0)[None], [f"n{k}" for k in range(P)]
    read: TrackFile = read_fields(tmp_path / "a.h5")
    np.testing.assert_array_equal(read.tracks, tracks)
    assert read.ids[:2] == ("n0", "n1") and read.labels is None
