"""The eight sequences: their layouts, on files written here and on the real ones, and messages about broken files."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from nrsfm.datasets.body import Array, Body, centre, spread
from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.composition import view
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.generated.procedural import stand_in as generated
from nrsfm.datasets.real.mocap import (
    MOTIONS,
    SEQUENCES,
    SHARK_CAMERAS,
    file_of,
    load_body,
    load_scene,
    recording,
)
from nrsfm.datasets.real.mocap_body import load_recording, load_single
from nrsfm.datasets.registration import REGISTRATIONS
from nrsfm.datasets.registry import digest
from nrsfm.datasets.registry import load_scene as load_by_settings

AKHTER = ("drink", "pickup", "yoga", "stretch")
MATLAB_7_3 = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(600)
NOT_NUMBERS = {"char": "a text", "cell": np.array([{}, []], dtype=object), "struct": {"x": 1.0}}


def random_structure(name: str) -> Array:
    source = SEQUENCES[name]
    return np.random.default_rng(len(name)).standard_normal((source.n_frames, 3, source.n_points))


def interleaved(S: Array) -> Array:
    """Rows x, y, z of frame 0, then of frame 1, ...: written row by row, to be checked against reshapes."""
    return np.array([S[f, axis] for f in range(len(S)) for axis in range(3)])


def blocks(S: Array) -> Array:
    """All rows of x, then all of y, then all of z."""
    return np.array([S[f, axis] for axis in range(3) for f in range(len(S))])


def fields(name: str, motion: str, S: Array) -> dict[str, Any]:
    if file_of(name, motion) == f"mocap/{SHARK_CAMERAS}":
        return {"S": np.stack(list(S), axis=2), "R": np.zeros((3, 3, len(S)))}
    if SEQUENCES[name].layout == "blocks":
        return {"P3_gt": blocks(S)}
    return {"S": interleaved(S), "list": np.array([[1.0, 2.0], [2.0, S.shape[2]]])}


def write(folder: Path, name: str, motion: str = "registered", **changes: Any) -> Path:
    """The sequence's file with random points of the right size; a change to None leaves a field out."""
    path = folder / file_of(name, motion)
    path.parent.mkdir(exist_ok=True)
    contents = {**fields(name, motion, random_structure(name)), **changes}
    scipy.io.savemat(path, {key: value for key, value in contents.items() if value is not None})
    return path


def complaint(folder: Path, name: str, motion: str = "registered") -> str:
    with pytest.raises(DatasetError) as caught:
        load_body(folder, name, motion)
    text = str(caught.value)
    assert "\n" not in text and str(folder / file_of(name, motion)) in text
    return text


# Layouts


@pytest.mark.parametrize("registration", REGISTRATIONS)
@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", SEQUENCES)
def test_layout(tmp_path: Path, name: str, motion: str, registration: str) -> None:
    write(tmp_path, name, motion)
    body, S = load_body(tmp_path, name, motion, registration), random_structure(name)
    turning = motion == "registered" and name in ("dance", "face", "walking")
    shape = REGISTRATIONS[registration](S, body.vertical) if turning else S
    np.testing.assert_allclose(body.structure, shape, atol=1e-12)
    assert body.structure.flags.c_contiguous
    assert body.name == name and not body.stand_in and len(body.digest) == 64
    assert body.vertical == ("y" if name in ("face", "walking", "shark") else "z")
    bones = [[0, 1], [1, S.shape[2] - 1]] if name in AKHTER else np.zeros((0, 2))
    np.testing.assert_array_equal(body.edges, bones)


@pytest.mark.parametrize("name", ["face", "walking", "shark"])
def test_files_of_matlab_4(tmp_path: Path, name: str, guarded: None) -> None:
    """What the three oldest sequences are in."""
    path = write(tmp_path, name, "native")
    scipy.io.savemat(path, fields(name, "native", random_structure(name)), format="4")
    np.testing.assert_array_equal(load_body(tmp_path, name, "native").structure, random_structure(name))
    whole = path.read_bytes()
    for kept in (1, 22, 1000, len(whole) - 1):
        path.write_bytes(whole[:kept])
        complaint(tmp_path, name, "native")


def test_compressed_files(tmp_path: Path, guarded: None) -> None:
    path = write(tmp_path, "yoga")
    scipy.io.savemat(path, fields("yoga", "registered", random_structure("yoga")), do_compression=True)
    np.testing.assert_array_equal(load_body(tmp_path, "yoga").structure, random_structure("yoga"))
    whole = path.read_bytes()
    for kept in (150, 5_000, len(whole) // 2):
        path.write_bytes(whole[:kept])
        complaint(tmp_path, "yoga")


def test_digest_follows_the_file(tmp_path: Path) -> None:
    write(tmp_path, "yoga")
    first = load_body(tmp_path, "yoga").digest
    write(tmp_path, "yoga", S=interleaved(random_structure("yoga") + 1))
    assert load_body(tmp_path, "yoga").digest != first


# A body's own cameras


def camera_fields(name: str) -> dict[str, Any]:
    """Fields Rs and W that go with the random points: another camera in every frame."""
    S = random_structure(name)
    R = np.linalg.qr(np.random.default_rng(7).standard_normal((len(S), 3, 3)))[0][:, :2]
    return {"Rs": R.reshape(-1, 3), "W": np.concatenate(list(R @ S))}


@pytest.mark.parametrize("name", SEQUENCES)
def test_own_cameras(tmp_path: Path, name: str) -> None:
    contents = camera_fields(name) if name in AKHTER else {}
    write(tmp_path, name, "native", **contents)
    body, S = load_recording(tmp_path, name), random_structure(name)
    np.testing.assert_array_equal(body.structure, S)
    assert body.cameras is not None
    if name in AKHTER:
        np.testing.assert_array_equal(body.cameras.reshape(-1, 3), contents["Rs"])
    else:
        seen = S[:, 1:] if name == "dance" else S[:, :2]
        np.testing.assert_array_equal(project(body.cameras, S), seen)
    scene = load_single(tmp_path, name)
    assert scene.n_bodies == 1 and scene.bodies == (name,) and scene.name == name and scene.digest == body.digest
    assert scene.structure is not None and scene.cameras is not None
    np.testing.assert_allclose(scene.structure, centre(S), atol=1e-12)
    np.testing.assert_array_equal(project(scene.cameras, scene.structure), scene.tracks)


def test_tracks_that_the_cameras_do_not_give(tmp_path: Path) -> None:
    contents = camera_fields("yoga")
    contents["W"][3, 4] += 1e-3
    path = write(tmp_path, "yoga", "native", **contents)
    with pytest.raises(DatasetError, match="W are not Rs S") as caught:
        load_recording(tmp_path, "yoga")
    assert str(path) in str(caught.value)
    write(tmp_path, "yoga", "native", W=contents["W"])
    with pytest.raises(DatasetError, match="field Rs is missing"):
        load_single(tmp_path, "yoga")
    write(tmp_path, "yoga", "native", **(contents | {"Rs": contents["Rs"][1:]}))
    with pytest.raises(DatasetError, match="field Rs has shape"):
        load_single(tmp_path, "yoga")


def test_a_body_without_cameras_has_no_view() -> None:
    with pytest.raises(DatasetError, match="no cameras of its own"):
        view(Body("dance", random_structure("dance")))


def test_single_bodies_by_settings(tmp_path: Path) -> None:
    settings = {"source": "mocap_body", "name": "turner", "body": "walking", "rank": 8}
    for refused in (load_by_settings, digest):
        with pytest.raises(MissingData):
            refused(settings, tmp_path)
    made = load_by_settings(settings, tmp_path, stand_in=True)
    assert made.stand_in and made.bodies == ("walking",) and made.tracks.shape == (260, 2, 55)
    write(tmp_path, "walking", "native")
    scene = load_by_settings(settings, tmp_path, stand_in=True)
    assert not scene.stand_in and scene.name == "turner"
    assert digest(settings, tmp_path) == scene.digest
    with pytest.raises(DatasetError, match="names 'jump'"):
        load_by_settings(settings | {"body": "jump"}, tmp_path)


# Files that are not what they should be


def test_missing_file(tmp_path: Path) -> None:
    assert "nrsfm data get" in complaint(tmp_path, "drink")
    with pytest.raises(MissingData):
        load_body(tmp_path, "drink")
    with pytest.raises(MissingData):
        load_scene(tmp_path, ["drink", "yoga"])


def test_a_missing_sequence_can_be_stood_in_for(tmp_path: Path) -> None:
    write(tmp_path, "yoga")
    scene = load_scene(tmp_path, ["yoga", "dance"], stand_in=True)
    assert scene.stand_in and scene.bodies == ("yoga", "dance")
    assert scene.digest.split() == [load_body(tmp_path, "yoga").digest, generated("dance", 264, 75).digest]
    assert not load_scene(tmp_path, ["yoga", "yoga"], stand_in=True).stand_in


def test_a_broken_file_is_never_stood_in_for(tmp_path: Path, guarded: None) -> None:
    write(tmp_path, "yoga").write_bytes(b"broken")
    with pytest.raises(DatasetError) as caught:
        load_scene(tmp_path, ["yoga"], stand_in=True)
    assert not isinstance(caught.value, MissingData)


@pytest.mark.parametrize("kept", [0, 127, 128, 140, 200, 100_000])
@pytest.mark.parametrize("name", ["yoga"])
def test_truncated_file(tmp_path: Path, name: str, kept: int, guarded: None) -> None:
    path = write(tmp_path, name)
    path.write_bytes(path.read_bytes()[:kept])
    complaint(tmp_path, name)


@pytest.mark.parametrize("content", [b"hello\n" * 100, b"\x89HDF\r\n\x1a\n" + bytes(600), MATLAB_7_3])
def test_file_of_another_kind(tmp_path: Path, content: bytes, guarded: None) -> None:
    write(tmp_path, "face").write_bytes(content)
    complaint(tmp_path, "face")


@pytest.mark.parametrize("place", range(124, 224, 9))
def test_bits_turned_over(tmp_path: Path, place: int, guarded: None) -> None:
    """Whatever is done to a byte of the file's head: a body or one clear line, and never the end of the process."""
    path = write(tmp_path, "yoga")
    content = bytearray(path.read_bytes())
    content[place] ^= 0xFF
    path.write_bytes(content)
    try:
        load_body(tmp_path, "yoga")
    except DatasetError as error:
        assert "\n" not in str(error)
        assert str(path) in str(error)


def test_missing_field(tmp_path: Path) -> None:
    write(tmp_path, "yoga", S=None, T=np.eye(3))
    text = complaint(tmp_path, "yoga")
    assert "field S is missing" in text and "T" in text
    write(tmp_path, "face", P3_gt=None)
    assert "field P3_gt is missing" in complaint(tmp_path, "face")
    write(tmp_path, "drink", list=None)
    assert "field list is missing" in complaint(tmp_path, "drink")


@pytest.mark.parametrize("name", ["pickup", "walking", "shark", "dance"])
@pytest.mark.parametrize("shape", [(10, 10), (3, 5, 7), (0, 0)])
def test_wrong_shape(tmp_path: Path, name: str, shape: tuple[int, ...]) -> None:
    key = "P3_gt" if name == "walking" else "S"
    wrong: dict[str, Any] = {key: np.ones(shape)}
    write(tmp_path, name, **wrong)
    assert f"field {key} has shape {shape}" in complaint(tmp_path, name)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["stretch", "face", "shark"])
def test_values_that_are_not_finite(tmp_path: Path, name: str, bad: float) -> None:
    S = random_structure(name)
    S[5, 1, 7] = bad
    broken: dict[str, Any] = fields(name, "registered", S)
    write(tmp_path, name, **broken)
    assert "NaN or infinite" in complaint(tmp_path, name)


@pytest.mark.parametrize("kind", NOT_NUMBERS)
def test_a_field_without_numbers(tmp_path: Path, kind: str, guarded: None) -> None:
    write(tmp_path, "dance", S=NOT_NUMBERS[kind])
    assert "wanted numbers" in complaint(tmp_path, "dance")


def test_a_claimed_huge_size(tmp_path: Path, guarded: None) -> None:
    """The array's header promises 2^30 x 41 numbers; nobody reserves memory for it."""
    path = write(tmp_path, "yoga", list=None)
    content = bytearray(path.read_bytes())
    source = SEQUENCES["yoga"]
    honest = struct.pack("<2i", 3 * source.n_frames, source.n_points)
    assert content.count(honest) == 1
    path.write_bytes(content.replace(honest, struct.pack("<2i", 2**30, source.n_points)))
    assert "claims" in complaint(tmp_path, "yoga")


@pytest.mark.parametrize("pairs", [[[0, 1]], [[1, 42]], [[1, 2, 3]], [[np.nan, 1]]])
def test_bones_that_name_no_points(tmp_path: Path, pairs: list[list[float]]) -> None:
    write(tmp_path, "drink", list=np.array(pairs, dtype=float))
    assert "field list" in complaint(tmp_path, "drink")


def test_a_body_may_have_no_bones(tmp_path: Path) -> None:
    write(tmp_path, "drink", list=np.zeros((0, 2)))
    assert load_body(tmp_path, "drink").edges.shape == (0, 2)


def test_unknown_names(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"dataset\.bodies names 'jump'"):
        recording("jump")
    with pytest.raises(DatasetError, match=r"dataset\.bodies names 'jump'"):
        load_scene(tmp_path, ["jump"])
    with pytest.raises(DatasetError, match=r"dataset\.motion is 'own'"):
        load_body(tmp_path, "yoga", "own")
    with pytest.raises(DatasetError, match=r"dataset\.registration is 'none'"):
        load_body(tmp_path, "yoga", registration="none")


# The real files


@pytest.mark.data
@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", SEQUENCES)
def test_real_sequence_has_the_published_size(data_folder: Path, name: str, motion: str) -> None:
    sizes = {"drink": (1102, 41), "pickup": (357, 41), "yoga": (307, 41), "stretch": (370, 41), "dance": (264, 75)}
    sizes |= {"face": (316, 40), "walking": (260, 55), "shark": (240, 91)}
    body = load_body(data_folder, name, motion)
    assert (body.n_frames, body.n_points) == sizes[name]


@pytest.mark.data
@pytest.mark.parametrize("name", AKHTER)
def test_akhter_files_hold_their_own_tracks_and_cameras(data_folder: Path, name: str) -> None:
    stored = scipy.io.loadmat(data_folder / f"mocap/{name}.mat")
    S = load_body(data_folder, name).structure
    n_frames, _, n_points = S.shape
    R = stored["Rs"].reshape(n_frames, 2, 3)
    np.testing.assert_allclose(project(R, S), stored["W"].reshape(n_frames, 2, n_points), atol=1e-12)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(2), (n_frames, 2, 2)), atol=1e-12)
    np.testing.assert_allclose(S.mean(axis=2), 0, atol=1e-12)
    assert spread(S) == pytest.approx(1, abs=1e-12)
    assert float(stored["theta"].item()) == 5


@pytest.mark.data
@pytest.mark.parametrize("name", AKHTER)
def test_akhter_cameras_turn_five_degrees_a_frame_about_z(data_folder: Path, name: str) -> None:
    stored = scipy.io.loadmat(data_folder / f"mocap/{name}.mat")
    R = stored["Rs"].reshape(-1, 2, 3)
    np.testing.assert_allclose(R[:, 1], np.broadcast_to([0, 0, 1], (len(R), 3)), atol=1e-12)
    angle = np.unwrap(np.arctan2(R[:, 0, 1], R[:, 0, 0]))
    np.testing.assert_allclose(np.abs(np.diff(angle)), np.deg2rad(5), atol=1e-10)
    sense = np.sign(angle[1] - angle[0])
    start = np.rad2deg(angle[0])
    orbiting = orbit(len(R) + 80, sense * 5.0)
    first = round(start / 5.0 * sense) % 72
    np.testing.assert_allclose(R, orbiting[first : first + len(R)], atol=1e-8)


@pytest.mark.data
@pytest.mark.parametrize("name", SEQUENCES)
def test_single_body_is_what_its_own_cameras_see(data_folder: Path, name: str) -> None:
    scene = load_single(data_folder, name)
    assert scene.structure is not None and scene.cameras is not None
    np.testing.assert_array_equal(project(scene.cameras, scene.structure), scene.tracks)
    np.testing.assert_allclose(scene.structure, centre(load_body(data_folder, name, "native").structure), atol=1e-12)
    assert (scene.n_frames, scene.n_points) == (SEQUENCES[name].n_frames, SEQUENCES[name].n_points)
    if name in (*AKHTER, "dance"):
        stored = scipy.io.loadmat(data_folder / f"mocap/{name}.mat")["W"].reshape(scene.tracks.shape)
        np.testing.assert_allclose(scene.tracks, centre(stored), atol=1e-12)
    else:
        stacked = scipy.io.loadmat(data_folder / f"mocap/{file_of(name, 'native').split('/')[1]}")["P3_gt"]
        X, Y, _ = np.split(stacked, 3)
        np.testing.assert_allclose(scene.tracks, centre(np.stack([X, Y], axis=1)), atol=1e-9)
    assert (np.ptp(scene.cameras, axis=0) == 0).all() == (name not in AKHTER)


@pytest.mark.data
def test_dance_camera_is_fixed(data_folder: Path) -> None:
    stored = scipy.io.loadmat(data_folder / "mocap/dance.mat")
    S = load_body(data_folder, "dance", "native").structure
    np.testing.assert_allclose(S[:, 1:], stored["W"].reshape(264, 2, 75), atol=1e-12)
    assert spread(S) == pytest.approx(1, abs=1e-9)
    assert "Rs" not in stored


@pytest.mark.data
@pytest.mark.parametrize(("name", "size"), [("face", 36.1), ("walking", 235.2), ("shark", 28.5)])
def test_torresani_files_are_in_blocks(data_folder: Path, name: str, size: float) -> None:
    """Read as blocks a point moves little from frame to frame; read as interleaved rows it would jump."""
    S = load_body(data_folder, name, "native").structure
    assert spread(S) == pytest.approx(size, abs=0.05)
    wrong = blocks(S).reshape(S.shape)
    step, jump = np.abs(np.diff(S, axis=0)).mean(), np.abs(np.diff(wrong, axis=0)).mean()
    assert step < 0.5 * jump


@pytest.mark.data
def test_shark_cameras_carry_its_whole_motion(data_folder: Path) -> None:
    """210.4985 R S is the centred ground truth of jaws.mat, and S spans exactly three shapes."""
    R = scipy.io.loadmat(data_folder / f"mocap/{SHARK_CAMERAS}")["R"].transpose(2, 0, 1)
    S = load_body(data_folder, "shark").structure
    truth = centre(load_body(data_folder, "shark", "native").structure)
    assert np.abs(centre(210.4985 * R @ S) - truth).max() < 1e-4 * np.abs(truth).max()
    s = np.linalg.svd(S.reshape(240, -1), compute_uv=False)
    assert s[2] / s[0] > 1e-4 and s[3] / s[0] < 1e-6


@pytest.mark.data
@pytest.mark.parametrize("name", AKHTER)
def test_bones_join_points_that_keep_their_distance(data_folder: Path, name: str) -> None:
    body = load_body(data_folder, name)
    assert len(body.edges) > 50
    i, j = body.edges.T
    length = np.linalg.norm(body.structure[:, :, i] - body.structure[:, :, j], axis=1)
    far = np.random.default_rng(0).permutation(body.n_points)
    apart = np.linalg.norm(body.structure - body.structure[:, :, far], axis=1)
    assert np.median(length.std(axis=0)) < 0.5 * np.median(apart.std(axis=0))


def test_sequences_that_are_turned_upright_are_known_ones(tmp_path: Path) -> None:
    """One list serves scenes with and without the body; a name that no sequence has is an error."""
    for name in ("yoga", "walking"):
        write(tmp_path, name)
    upright, same, stored = (
        load_scene(tmp_path, ["yoga", "walking"], turn_upright=turned)
        for turned in (["walking", "face"], ["walking"], False)
    )
    np.testing.assert_array_equal(upright.tracks, same.tracks)
    assert np.abs(upright.tracks - stored.tracks).max() > 0.1
    with pytest.raises(DatasetError, match=r"dataset\.upright names 'walker'"):
        load_scene(tmp_path, ["yoga", "walking"], turn_upright=["walker"])
