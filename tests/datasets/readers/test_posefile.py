"""Poses in JSON as OpenPose, COCO and AlphaPose write them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.posefile import read_json
from nrsfm.datasets.readers.trackfile import Asked
from nrsfm.datasets.real.tracks import DOWN, load_tracks

F, N = 12, 4  # more than ten frames: img_10 comes after img_9


@pytest.fixture
def tracks() -> np.ndarray:
    """Two persons of four points, (F, 2, 2 N), NaN where not observed."""
    rng = np.random.default_rng(0)
    W = np.round(rng.uniform(1, 640, (F, 2, 2 * N)), 3)
    return np.where(rng.random((F, 2 * N))[:, None] > 0.2, W, np.nan)


def points(W: np.ndarray, sure: float = 0.9) -> list[float]:
    """x, y, c, x, y, c, ... of one person in a frame; zeros for what was not found."""
    return [float(v) for x, y in W.T for v in ((0.0, 0.0, 0.0) if np.isnan(x) else (x, y, sure))]


def put(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path


def openpose(folder: Path, W: np.ndarray, ids: bool = True) -> Path:
    for f in range(F):
        people = [
            {
                "person_id": [k if ids else -1],
                "pose_keypoints_2d": points(W[f, :, N * k : N * k + N - 1]),
                "face_keypoints_2d": [],
                "hand_left_keypoints_2d": points(W[f, :, N * k + N - 1 : N * k + N]),
                "hand_right_keypoints_2d": [],
                "pose_keypoints_3d": [],
            }
            for k in (range(W.shape[2] // N) if f % 2 else reversed(range(W.shape[2] // N)))
        ]
        put(folder / f"walk_{f}_keypoints.json", {"version": 1.3, "people": people})
    return folder


def annotated(W: np.ndarray, key: str, image: Callable[[int], Any]) -> list[dict[str, Any]]:
    return [
        {"image_id": image(f), "category_id": 1, "keypoints": points(W[f, :, N * k : N * k + N], 2), key: k + 1}
        for f in range(F)
        for k in range(W.shape[2] // N)
    ]


def coco(folder: Path, W: np.ndarray) -> Path:
    images = [{"id": 100 - f, "file_name": f"img_{f}.jpg", "width": 640} for f in range(F)]
    category = {"id": 1, "name": "person", "keypoints": ["nose", "neck", "hip", "knee"], "skeleton": [[1, 2]]}
    held = annotated(W, "track_id", lambda f: 100 - f)
    content = {"info": {}, "images": images[::-1], "annotations": held, "categories": [category], "extra": 1}
    return put(folder / "a.json", content)


def alphapose(folder: Path, W: np.ndarray) -> Path:
    return put(folder / "results.json", annotated(W, "idx", lambda f: f"{f}.jpg"))


@pytest.mark.parametrize("write", [openpose, coco, alphapose], ids=lambda write: write.__name__)
def test_two_persons(write: Callable[..., Path], tracks: np.ndarray, tmp_path: Path) -> None:
    path = write(tmp_path, tracks)
    read = read_json(path)
    np.testing.assert_array_equal(read.tracks, tracks)
    assert read.image and len(read.bodies) == 2
    np.testing.assert_array_equal(read.labels, np.arange(2 * N) // N)
    ids = {openpose: "1.pose_1", coco: "2.neck", alphapose: "2.1"}
    frames = {openpose: "walk_10", coco: "img_10.jpg", alphapose: "10.jpg"}
    assert read.ids[N + 1] == ids[write] and read.frames[10] == frames[write]
    assert read.notes[0].startswith("read as ")
    assert ("not used: field extra" in read.notes) == (write is coco)
    scene = load_tracks(path)
    assert scene.tracks.shape == tracks.shape and scene.notes[-1] == DOWN


def test_the_folder_is_what_is_digested(tracks: np.ndarray, tmp_path: Path) -> None:
    before = load_tracks(openpose(tmp_path, tracks)).digest
    assert load_tracks(openpose(tmp_path, tracks)).digest == before
    assert load_tracks(openpose(tmp_path, tracks + 1)).digest != before


def test_confidence(tracks: np.ndarray, tmp_path: Path) -> None:
    openpose(tmp_path, tracks)
    assert np.isnan(read_json(tmp_path, Asked(confidence=0.5)).tracks).mean() == np.isnan(tracks).mean()
    with pytest.raises(DatasetError, match="too few"):
        load_tracks(tmp_path, asked=Asked(confidence=0.95))


def test_one_person_needs_no_name(tracks: np.ndarray, tmp_path: Path) -> None:
    read = read_json(openpose(tmp_path, tracks[:, :, :N], ids=False))
    np.testing.assert_array_equal(read.tracks, tracks[:, :, :N])
    assert read.labels is None and read.ids == ("pose_0", "pose_1", "pose_2", "hand_left_0")


def test_persons_without_names_are_refused(tracks: np.ndarray, tmp_path: Path) -> None:
    refused(openpose(tmp_path, tracks, ids=False), "does not say who is who; track them with the pose estimator")


BROKEN: dict[str, Any] = {
    "it is no file of OpenPose or COCO": {"a": 1},
    "not as OpenPose writes it": {"people": [3]},
    "not as COCO writes it (KeyError: 'image_id')": {"annotations": [{"keypoints": [1, 2, 1]}]},
    "it holds no points": {"people": []},
    "wanted 6 finite ones": [{"image_id": k, "keypoints": [1, 2, 1] * (k + 1)} for k in range(2)],
    "wanted 3 finite ones": [{"image_id": 1, "keypoints": [1, "a", 1]}],
    "wanted 3 finite ones ": [{"image_id": 1, "keypoints": [1, float("nan"), 1]}],
    "frame '1', '4', occurs twice": [{"image_id": 1, "keypoints": [1, 2, 1], "idx": 4}] * 2,
}


@pytest.mark.parametrize("message", BROKEN)
def test_what_does_not_fit(message: str, tmp_path: Path) -> None:
    refused(put(tmp_path / "a.json", BROKEN[message]), message.strip())


@pytest.mark.parametrize("content", [b"{", b"\xff", b"[" * 100_000, b'{"people": [' + b"9" * 5000 + b"]}"])
def test_damaged_files(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(content)
    refused(tmp_path / "a.json", "not")


def test_an_empty_folder(tmp_path: Path) -> None:
    refused(tmp_path, "it holds no .json files")


def refused(path: Path, *words: str) -> None:
    with pytest.raises(DatasetError) as caught:
        read_json(path)
    line = str(caught.value)
    assert all(word in line for word in words), line
    assert path.name in line and line.isprintable() and len(line) < 500 + len(str(path))
