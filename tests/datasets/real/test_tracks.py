"""A user's own tracks: every format gives the same scene, and a file that does not fit is refused in one line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from nrsfm.datasets import registry
from nrsfm.datasets.body import centre, spread
from nrsfm.datasets.cameras import orbit
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.public import catalogue as sources
from nrsfm.datasets.readers import textfile, trackfile
from nrsfm.datasets.readers.trackfile import Asked
from nrsfm.datasets.real.tracks import DOWN, load_tracks
from nrsfm.datasets.scene import Scene
from tests.datasets.conftest import MARKERS, WriteC3D

F, P = 12, 7
UPWARDS = np.array([[1.0], [-1.0]])  # the tracks of these tests are pixels, y downwards
LABELS = np.array([3, 1, 1, 3, 1, 3, 3])


@pytest.fixture
def scene() -> Scene:
    """Random tracks of two bodies, in pixels, of which some are not observed."""
    rng = np.random.default_rng(0)
    cameras, structure = orbit(F, 9.0), 100 * rng.standard_normal((F, 3, P))
    visible = rng.random((F, P)) > 0.2
    W = cameras @ structure + np.array([320.0, 240.0])[:, None]
    return Scene("x", np.where(visible[:, None], W, np.nan), (), LABELS, centre(structure), cameras, visible)


def fields(scene: Scene) -> dict[str, Any]:
    assert scene.structure is not None and scene.cameras is not None and scene.labels is not None
    return {
        "W": scene.tracks.reshape(2 * F, P),
        "S": scene.structure.reshape(3 * F, P),
        "Rs": scene.cameras.reshape(2 * F, 3),
        "s": scene.labels[:, None].astype(float),
    }


def npz(path: Path, scene: Scene) -> Path:
    parts: dict[str, Any] = {
        "tracks": scene.tracks,
        "structure": scene.structure,
        "cameras": scene.cameras,
        "labels": scene.labels,
    }
    path = path / "a.npz"
    np.savez_compressed(path, **{k: v for k, v in parts.items() if v is not None})
    return path


def npz_with_mask(path: Path, scene: Scene) -> Path:
    path = path / "mask.npz"
    whole = np.where(np.isnan(scene.tracks), 7.0, scene.tracks)
    np.savez(path, **fields(scene) | {"W": whole.reshape(2 * F, P), "visible": scene.visible})
    return path


def mat(path: Path, scene: Scene) -> Path:
    scipy.io.savemat(path / "a.mat", fields(scene), do_compression=True)
    return path / "a.mat"


def mat_of_three_dimensions(path: Path, scene: Scene) -> Path:
    arrays = {"tracks": scene.tracks, "structure": scene.structure, "cameras": scene.cameras, "labels": scene.labels}
    scipy.io.savemat(path / "b.MAT", arrays)
    return path / "b.MAT"


def mat4(path: Path, scene: Scene) -> Path:
    scipy.io.savemat(path / "c.mat", fields(scene), format="4")
    return path / "c.mat"


def mat73(path: Path, scene: Scene) -> Path:
    with h5py.File(path / "d.mat", "w") as file:
        for name, value in fields(scene).items():
            file.create_dataset(name, data=value.T).attrs["MATLAB_class"] = np.bytes_("double")
    return path / "d.mat"


def long(path: Path, scene: Scene) -> Path:
    """Lines in no order, gaps left out."""
    assert scene.visible is not None and scene.labels is not None
    lines = [
        f"{scene.labels[p]},{p},{f},{float(scene.tracks[f, 1, p])!r},{float(scene.tracks[f, 0, p])!r}"
        for f, p in np.random.default_rng(1).permutation(np.argwhere(scene.visible))
    ]
    return write(path / "a.csv", "label,track,frame,y,x", *lines)


def long_with_mask(path: Path, scene: Scene) -> Path:
    assert scene.visible is not None and scene.labels is not None
    lines = [
        f"{f},{p},{'' if not v else repr(float(scene.tracks[f, 0, p]))},"
        f"{'nan' if not v else repr(float(scene.tracks[f, 1, p]))},{['false', 'TRUE'][int(v)]},{scene.labels[p]}"
        for (f, p), v in np.ndenumerate(scene.visible)
    ]
    return write(path / "b.csv", "frame, track, x, y, visible, label", *lines)


def wide(path: Path, scene: Scene) -> Path:
    cells = [["" if np.isnan(v) else repr(float(v)) for v in row.T.ravel()] for row in scene.tracks]
    header = ",".join(f"x_{p},y_{p}" for p in range(P))
    return write(path / "c.csv", header, *(",".join(row) for row in cells))


def wide_named(path: Path, scene: Scene) -> Path:
    cells = [["nan" if np.isnan(v) else repr(float(v)) for v in row.T.ravel()] for row in scene.tracks]
    rows = [f"{f}," + ",".join(row) for f, row in enumerate(cells)]
    return write(path / "d.csv", "frame," + ",".join(f"{p}.x,{p}.y" for p in range(P)), *rows[::-1])


def write(path: Path, *lines: str, end: str = "\r\n") -> Path:
    path.write_bytes("".join(line + end for line in lines).encode())
    return path


WHOLE = [npz, npz_with_mask, mat, mat_of_three_dimensions, mat4, mat73]
LABELLED = [*WHOLE, long, long_with_mask]


@pytest.mark.parametrize("save", [*LABELLED, wide, wide_named], ids=lambda save: save.__name__)
def test_every_format_gives_the_same_scene(save: Callable[[Path, Scene], Path], scene: Scene, tmp_path: Path) -> None:
    path = save(tmp_path, scene)
    read = load_tracks(path, "x")
    np.testing.assert_allclose(read.tracks, centre(scene.tracks * UPWARDS), atol=1e-12)
    np.testing.assert_array_equal(read.visible, scene.visible)
    assert read.track_ids == tuple(map(str, range(P))) and read.frame_ids == tuple(map(str, range(F)))
    assert read.digest == sources.sha256(path) and read.notes == (DOWN,)
    if save in LABELLED:
        np.testing.assert_array_equal(read.labels, LABELS == 3)
        assert read.bodies == ("1", "3")
    else:
        assert read.labels is None
    if save in WHOLE:
        assert read.structure is not None and read.cameras is not None
        assert scene.structure is not None and scene.cameras is not None
        np.testing.assert_array_equal(read.structure, centre(scene.structure))
        np.testing.assert_allclose(read.cameras, scene.cameras * UPWARDS, atol=1e-12)
    else:
        assert read.structure is None and read.cameras is None


def test_a_file_is_a_dataset(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {"source": "tracks", "name": "mine", "file": str(npz(tmp_path, scene))}
    loaded = registry.load_scene(settings, tmp_path / "data")
    assert loaded.name == "mine" and registry.digest(settings, tmp_path / "data") == loaded.digest
    for folder in (".", "elsewhere"):  # from the current folder, else from the data folder
        monkeypatch.chdir(tmp_path)
        named = settings | {"file": "a.npz"}
        assert registry.digest(named, tmp_path if folder == "elsewhere" else Path("none")) == loaded.digest
    for call in (registry.load_scene, registry.digest):
        with pytest.raises(MissingData, match=r"b\.npz is not there"):
            call(settings | {"file": "b.npz"}, tmp_path)
        with pytest.raises(DatasetError, match=r"dataset\.file is 3"):
            call(settings | {"file": 3}, tmp_path)


def test_frames_and_tracks_of_any_names(tmp_path: Path) -> None:
    lines = [f"{f},{t},{i}.5,{j}" for i, f in enumerate((10, 9, -2)) for j, t in enumerate(("nose", "ear é", '"a,b"'))]
    read = load_tracks(write(tmp_path / "a.csv", "\ufeffframe,track,x,y", *lines, "", end="\n"))
    assert read.frame_ids == ("-2", "9", "10") and read.track_ids == ("nose", "ear é", "a,b")
    np.testing.assert_array_equal(read.tracks[0], [[0.0, 0.0, 0.0], [1.0, 0.0, -1.0]])  # y upwards
    assert (
        read.name == "a"
        and load_tracks(write(tmp_path / "m y é.csv", "x_0,y_0,x_1,y_1", *["1,2,3,4"] * 2)).name == "m_y"
    )


def test_what_is_never_seen_is_left_out_and_told(scene: Scene, tmp_path: Path) -> None:
    W = scene.tracks.copy()
    visible = np.ones((F, P), dtype=bool)
    W[:] = np.random.default_rng(2).standard_normal(W.shape)
    visible[:, 2] = visible[4] = False
    visible[7] = np.arange(P) == 0  # one track alone
    visible[:, 5] = np.arange(F) == 7  # then seen nowhere else
    np.savez(tmp_path / "a.npz", tracks=np.where(visible[:, None], W, np.nan), labels=LABELS)
    read = load_tracks(tmp_path / "a.npz")
    assert read.tracks.shape == (F - 2, 2, P - 2) and read.visible is None
    assert read.track_ids == ("0", "1", "3", "4", "6") and "4" not in read.frame_ids
    assert len(read.labels if read.labels is not None else ()) == P - 2
    assert read.notes == (
        "left out: 2 frames (4, 7), which show fewer than two tracks",
        "left out: 2 tracks (2, 5), which are seen in fewer than two frames",
    )


def test_a_body_that_is_left_out_leaves_no_label(tmp_path: Path) -> None:
    W = np.random.default_rng(0).standard_normal((5, 2, 4))
    W[:, :, 3] = np.nan
    np.savez(tmp_path / "a.npz", tracks=W, labels=[0, 2, 2, 1])
    read = load_tracks(tmp_path / "a.npz")
    assert read.bodies == ("0", "2") and read.labels is not None and read.labels.tolist() == [0, 1, 1]


def test_the_truth_is_brought_to_the_units_of_the_tracks(scene: Scene, tmp_path: Path) -> None:
    assert scene.structure is not None
    metres = replace(scene, structure=scene.structure / 250)
    for cameras in (metres.cameras, None):
        read = load_tracks(npz(tmp_path, replace(metres, cameras=cameras)))
        assert read.structure is not None
        np.testing.assert_allclose(read.structure, scene.structure, rtol=1e-9)
        assert "scaled by 250 to the units of the tracks" in read.notes[1]


def test_y_points_up_in_every_scene(scene: Scene, tmp_path: Path) -> None:
    """Whatever the file: what is high in the image has a large y. The truth and its cameras go with it."""
    path = npz(tmp_path, scene)
    for y, sign in (("auto", -1), ("down", -1), ("up", 1)):
        read = load_tracks(path, asked=Asked(y=y))
        np.testing.assert_allclose(read.tracks[:, 1], sign * centre(scene.tracks)[:, 1], atol=1e-12)
        assert (DOWN in read.notes) == (y == "auto") and read.cameras is not None and read.structure is not None
        seen = np.nan_to_num(np.where(np.isnan(read.tracks), np.nan, read.cameras @ read.structure))
        np.testing.assert_allclose(centre(np.where(seen, seen, np.nan)), read.tracks, atol=1e-9)
    centred = replace(scene, tracks=centre(scene.tracks))
    np.testing.assert_allclose(load_tracks(npz(tmp_path, centred)).tracks, centred.tracks, atol=1e-12)
    with pytest.raises(DatasetError, match="y is 'left', wanted one of auto, down, up"):
        load_tracks(path, asked=Asked(y="left"))


@pytest.mark.parametrize("mark", [0, -1])
def test_marks_of_missing_pixels_are_gaps(mark: int, scene: Scene, tmp_path: Path) -> None:
    W = np.where(np.isnan(scene.tracks), mark, scene.tracks)
    np.savez(tmp_path / "a.npz", tracks=W)
    read = load_tracks(tmp_path / "a.npz")
    np.testing.assert_array_equal(read.visible, scene.visible)
    assert f"positions are exactly ({mark}, {mark}) and count as not observed" in read.notes[0]


def test_zeros_that_may_be_gaps_are_told(tmp_path: Path) -> None:
    W = np.random.default_rng(0).standard_normal((5, 2, 4))
    W[3, :, 1] = W[4, :, 2] = 0
    np.savez(tmp_path / "a.npz", tracks=W)
    told = "2 positions are exactly (0, 0); if those were not observed, write NaN"
    assert load_tracks(tmp_path / "a.npz").notes == (told,)


def test_round_off_of_cameras_is_mended(scene: Scene, tmp_path: Path) -> None:
    assert scene.cameras is not None
    np.savez(tmp_path / "a.npz", tracks=scene.tracks, cameras=scene.cameras.astype(np.float32))
    cameras = load_tracks(tmp_path / "a.npz").cameras
    assert cameras is not None
    np.testing.assert_allclose(cameras, scene.cameras * UPWARDS, atol=1e-7)


def test_c3d_is_seen_by_a_camera(tmp_path: Path, write_c3d: WriteC3D) -> None:
    rng = np.random.default_rng(0)
    S = np.cumsum(rng.integers(-20, 20, (30, 3, 74)), axis=0) + rng.integers(200, 3000, (1, 3, 74)) / 4.0
    path = write_c3d(tmp_path / "two.c3d", S, [f"{who}:{marker}" for who in "AB" for marker in MARKERS])
    read = load_tracks(path)
    assert read.bodies == ("A", "B") and read.name == "two" and "5 degrees a frame" in read.notes[0]
    metres = centre(S / 1000)
    assert read.structure is not None
    np.testing.assert_allclose(read.structure, metres / spread(metres), atol=1e-6)
    np.testing.assert_array_equal(read.cameras, orbit(30))


CSV: dict[str, tuple[str, ...]] = {
    "is not a name": ("frame,track,x,y", "0,,1,2", "1,a,1,2"),
    "line 3 has 3 cells and the header 4": ("frame,track,x,y", "0,a,1,2", "1,a,1"),
    "line 5 has 5 cells": ("frame,track,x,y", "0,a,1,2", "", "1,a,1,2", "1,b,1,2,3"),
    "line 2: x is 'one', wanted a finite number": ("frame,track,x,y", "0,a,one,2"),
    "line 2: y is 'inf'": ("frame,track,x,y", "0,a,1,inf"),
    "line 2: x is '1_0'": ("frame,track,x,y", "0,a,1_0,1"),
    "line 3: visible is 'maybe', wanted 0 or 1": ("frame,track,x,y,visible", "0,a,1,1,1", "0,b,1,1,maybe"),
    "frame '0', track 'a' occurs twice": ("frame,track,x,y", "0,a,1,2", "0,b,1,2", "0,a,1,2"),
    "track 'a' has the labels '1' and '2'": ("frame,track,x,y,label", "0,a,1,2,1", "1,a,1,2,2"),
    "track 'b' has no label": ("frame,track,x,y,label", "0,a,1,2,1", "0,b,1,2,"),
    "its header holds a name twice": ("frame,track,x,y,x", "0,a,1,2,3"),
    "holds no observation": ("frame,track,x,y",),
    "names no track": ("",),
    "one coordinate alone": ("frame,track,x,y", "0,a,1,", "0,b,1,2", "1,a,1,2", "1,b,1,2"),
    "are too few": ("frame,track,x,y", "0,a,1,2", "1,b,1,2"),
    "one of x and y for '0'": ("x_0,y_1", "1,2"),
    "one of x and y for '1'": ("x_0,y_0,x_1", "1,2,3"),
    "holds id, t, u, v": ("id,t,u,v", "1,2,3,4"),
    "names a track twice": ("x_0,y_0,0.x,0.y", "1,2,3,4"),
    "line 3: x or y is 'q'": ("x_0,y_0", "1,2", "1,q"),
    "frame '3' occurs twice": ("frame,x_0,y_0", "3,1,2", "3,1,2"),
    "not a readable CSV file": ("frame,track,x,y", '0,"a"b,1,2'),
    "track 'b\\x07' is not a name": ("frame,track,x,y", "0,b\x07,1,2"),
}


@pytest.mark.parametrize("message", CSV)
def test_csv_that_does_not_fit(message: str, tmp_path: Path) -> None:
    refused(write(tmp_path / "a.csv", *CSV[message]), message)


def refused(path: Path, message: str) -> None:
    with pytest.raises(DatasetError) as caught:
        load_tracks(path)
    line = str(caught.value)
    assert message in line and str(path) in line
    assert "\n" not in line and len(line) < 500 and line.isprintable()


def broken(scene: Scene) -> Mapping[str, dict[str, Any]]:
    W, S, R = scene.tracks, scene.structure, scene.cameras
    assert S is not None and R is not None
    half, infinite, hole = W.copy(), W.copy(), S.copy()
    f, p = np.argwhere(~np.isnan(W[:, 0]))[0]
    half[f, 0, p], infinite[f, 0, p], hole[f, 1, p] = np.nan, np.inf, np.nan
    return {
        "it holds no tracks; save them as 'tracks' (F, 2, P)": {"structure": S},
        "it holds tracks twice, as tracks and W": {"tracks": W, "W": W},
        "field W has shape (3, 7), wanted (F, 2, P) or (2F, P)": {"W": np.ones((3, 7))},
        "field tracks has shape (5,), wanted": {"tracks": np.ones(5)},
        "field tracks is of type complex128, wanted numbers": {"tracks": W * 1j},
        "field tracks is of type <U1, wanted numbers": {"tracks": np.full((4, 2, 5), "a")},
        "has one coordinate alone; write both, or neither": {"tracks": half},
        f"frame {f}, track {p} is infinite; write NaN": {"tracks": infinite},
        "field S has shape (36, 6), wanted (12, 3, 7) or (36, 7)": {"W": W, "S": S.reshape(36, 7)[:, 1:]},
        f"the structure of frame {f}, track {p} is NaN": {"W": W, "S": hole},
        "unexplained; its rows are x, y, z for each frame": {"W": W, "S": S.transpose(1, 0, 2).reshape(36, 7), "R": R},
        "unexplained": {"W": W, "S": -S, "R": R},
        "field R has shape (12, 2, 2), wanted (12, 2, 3) or (24, 3)": {"W": W, "R": R[:, :, :2]},
        "rows are not orthonormal (off by 3)": {"W": W, "R": 2 * R},
        "the cameras hold NaN": {"W": W, "R": R * np.nan},
        "field labels has shape (6,), wanted (7,)": {"W": W, "labels": LABELS[1:]},
        "field labels holds NaN or fractions": {"W": W, "labels": LABELS + 0.5},
        "field s holds NaN or fractions": {"W": W, "s": LABELS * np.nan},
        "field visible has shape (7, 12), wanted (12, 7)": {"W": W, "visible": np.ones((7, 12))},
        "field visible holds other numbers than 0 to 1": {"W": W, "visible": np.full((12, 7), 1.5)},
        "is NaN in the tracks and 1 in visible; write 0 there": {"W": W, "visible": np.ones((12, 7))},
        "are too few; wanted two tracks and two frames": {"W": W * np.nan},
    }


@pytest.mark.parametrize("case", range(22))
def test_arrays_that_do_not_fit(case: int, scene: Scene, tmp_path: Path) -> None:
    message, arrays = list(broken(scene).items())[case]
    np.savez(tmp_path / "a.npz", **arrays)
    refused(tmp_path / "a.npz", message)


def test_all_cases_are_tried(scene: Scene) -> None:
    assert len(broken(scene)) == 22


def test_files_of_no_kind(tmp_path: Path, guarded: None) -> None:
    with pytest.raises(MissingData, match=r"none\.npz is not there; name a file of tracks"):
        load_tracks(tmp_path / "none.npz")
    (tmp_path / "a.xyz").write_text("x")
    refused(tmp_path / "a.xyz", "is of no known kind; wanted .npz, .npy, .mat, .h5, .hdf5, .csv")
    (tmp_path / "a.pkl").write_bytes(b"")
    refused(tmp_path / "a.pkl", "it runs code when it is read; save .npz instead")
    for suffix in ("npz", "mat", "c3d"):
        (tmp_path / f"a.{suffix}").write_bytes(b"no such thing")
        refused(tmp_path / f"a.{suffix}", "not a readable")
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00x")
    refused(tmp_path / "a.csv", "save it as UTF-8 text with commas")


def test_sizes_are_checked_before_memory_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [f"{k},{k},1,2" for k in range(3000)]  # 9 million positions, one in 3000 observed
    refused(write(tmp_path / "a.csv", "frame,track,x,y", *lines), "less than 1 in 100 observed")
    monkeypatch.setattr(textfile, "LINE", 1000)
    refused(write(tmp_path / "b.csv", "frame,track,x,y", "0," * 1000), "a line has more than 1000 characters")
    monkeypatch.setattr(trackfile, "MOST", 100)
    np.savez(tmp_path / "a.npz", tracks=np.ones((3, 2, 50)))
    refused(tmp_path / "a.npz", "it holds 3 frames of 50 tracks, more than 100 positions")
    monkeypatch.setattr(trackfile, "LONGEST", 4)
    refused(write(tmp_path / "c.csv", "x_0,y_0", *["1,2"] * 5), "it holds 5 frames of 1 tracks")


@settings(max_examples=150, deadline=None)
@given(
    st.binary(max_size=60), st.sampled_from(["frame,track,x,y\n", "x_0,y_0\n", "frame,track,x,y,label,visible\n", ""])
)
def test_any_csv_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, body: bytes, header: str) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(header.encode() + body)
    try:
        load_tracks(path)
    except DatasetError as error:
        assert str(error).isprintable()


@pytest.mark.data
def test_real_files(data_folder: Path) -> None:
    yoga = load_tracks(data_folder / "mocap/yoga.mat")
    assert yoga.tracks.shape == (307, 2, 41) and yoga.notes == ("not used: fields list, Shat, K, theta",)
    assert yoga.cameras is not None
    assert yoga.structure is not None
    np.testing.assert_allclose(yoga.cameras @ yoga.structure, yoga.tracks, atol=1e-9)
