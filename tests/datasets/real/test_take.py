"""Takes of several people: a file in UMPM's layout gives back the numbers that were written into it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nrsfm.datasets import registry
from nrsfm.datasets.body import Array, centre, spread
from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.public import catalogue as sources
from nrsfm.datasets.real.take import PERSON, bodies
from nrsfm.datasets.real.thinning import Thinning
from nrsfm.datasets.scene import Scene
from tests.datasets.conftest import MARKERS, WriteC3D

F = 40
PEOPLE = [f"{person}:{marker}" for person in ("LEFT", "RIGHT") for marker in MARKERS]
OTHERS = ["ball1", "ball2", "Table:a", "Table:b", "*17", "*18"]
LABELS = [*PEOPLE[:37], *OTHERS[:3], *PEOPLE[37:], *OTHERS[3:]]  # as they were tracked, not sorted
SETTINGS: dict[str, Any] = {
    "source": "take",
    "folder": "umpm",
    "take": "p2_free_2",
    "name": "p2_free_2",
    "persons": None,
}
SETTINGS |= {"others": "none", "vertical": "z", "video_rate": 50.0, "range": None, "stride": None, "frames": 400}
SETTINGS |= {"least_seen": 0.5, "degrees_per_frame": 5.0}


def load_take(folder: Path, group: str, take: str, **changes: Any) -> Scene:
    return registry.load_scene({**SETTINGS, "folder": group, "take": take, "name": None, **changes}, folder)


def points(n_markers: int = len(LABELS)) -> Array:
    """Two people and things in a room, in mm, in numbers that single precision holds exactly."""
    rng = np.random.default_rng(1)
    walk = np.cumsum(rng.integers(-20, 20, (F, 3, n_markers)), axis=0)
    return (walk + rng.integers(200, 3000, (1, 3, n_markers))) / 4.0


@pytest.fixture
def take(tmp_path: Path, write_c3d: WriteC3D) -> Path:
    return write_c3d(tmp_path / "umpm/p2_free_2.c3d", points(), LABELS)


def expected(P: Array) -> Array:
    """The scene's structure: at the video's rate, centred per frame, at unit spread."""
    S = centre(P[::2])
    return S / spread(S)


def of(prefix: str) -> list[int]:
    return [k for k, label in enumerate(LABELS) if label.startswith(prefix)]


def test_umpm_layout(take: Path, tmp_path: Path) -> None:
    scene = registry.load_scene(SETTINGS, tmp_path)
    S = expected(points()[:, :, of("LEFT:") + of("RIGHT:")])
    assert scene.structure is not None and scene.labels is not None and scene.cameras is not None
    np.testing.assert_allclose(scene.structure, S, atol=1e-12)
    np.testing.assert_array_equal(scene.labels, np.repeat([0, 1], 37))
    np.testing.assert_array_equal(scene.cameras, orbit(F // 2))
    np.testing.assert_array_equal(scene.tracks, project(scene.cameras, scene.structure))
    assert scene.bodies == ("LEFT", "RIGHT") and scene.name == "p2_free_2" and scene.visible is None
    assert scene.digest.split() == [sources.sha256(take)] * 2
    assert registry.digest(SETTINGS, tmp_path) == sources.sha256(take)


def test_as_the_archive_is_unpacked(tmp_path: Path, write_c3d: WriteC3D) -> None:
    write_c3d(tmp_path / "umpm/Groundtruth/p4_meet_12.c3d", points(), LABELS)
    assert load_take(tmp_path, "umpm", "p4_meet_12").n_points == 74


def test_absent_take_says_how_to_get_it(tmp_path: Path) -> None:
    for call in (registry.load_scene, registry.digest):
        with pytest.raises(MissingData, match=r"p2_free_2\.c3d is not there; ask for a login .* p2_free_2\.zip"):
            call(SETTINGS, tmp_path, True)  # nothing takes its place


def test_others(take: Path, tmp_path: Path) -> None:
    objects = load_take(tmp_path, "umpm", "p2_free_2", others="objects")
    assert objects.bodies == ("LEFT", "RIGHT", "Table", "ball")
    assert objects.labels is not None and np.bincount(objects.labels).tolist() == [37, 37, 2, 2]
    everything = load_take(tmp_path, "umpm", "p2_free_2", others="all")
    assert everything.bodies == ("LEFT", "RIGHT", "Table", "ball", "unlabelled")
    one = load_take(tmp_path, "umpm", "p2_free_2", persons=["RIGHT"])
    assert one.bodies == ("RIGHT",) and one.n_points == 37


def test_gaps(tmp_path: Path, write_c3d: WriteC3D) -> None:
    P = points()
    a, b, c = of("LEFT:")[5], of("RIGHT:")[0], of("RIGHT:")[36]
    P[4:10, :, a], P[:30, :, b], P[0:2, :, c] = np.nan, np.nan, 0.0
    write_c3d(tmp_path / "umpm/p2_free_2.c3d", P, LABELS)
    scene = registry.load_scene(SETTINGS, tmp_path)
    P[0:2, :, c] = np.nan
    kept = [k for k in of("LEFT:") + of("RIGHT:") if k != b]  # seen in a quarter of the frames: left out
    assert scene.structure is not None and scene.visible is not None
    np.testing.assert_allclose(scene.structure, expected(P[:, :, kept]), atol=1e-12)
    np.testing.assert_array_equal(scene.visible, np.isfinite(P[::2, 0, kept]))
    np.testing.assert_array_equal(np.isnan(scene.tracks).all(axis=1), ~scene.visible)
    every = registry.load_scene(SETTINGS | {"least_seen": 0.0}, tmp_path)
    assert every.n_points == 74
    never = registry.load_scene(SETTINGS | {"least_seen": 0.0, "range": [0, 15]}, tmp_path)
    assert never.n_points == 73  # a marker that is never seen has no track


def test_frames_in_which_nothing_is_seen(tmp_path: Path, write_c3d: WriteC3D) -> None:
    P = points()
    P[6] = np.nan
    write_c3d(tmp_path / "umpm/p2_free_2.c3d", P, LABELS)
    with pytest.raises(DatasetError, match="nothing is seen in frame 3"):
        registry.load_scene(SETTINGS, tmp_path)
    assert registry.load_scene(SETTINGS | {"range": [4, 20]}, tmp_path).n_frames == 16


def test_virtual_markers(tmp_path: Path, write_c3d: WriteC3D) -> None:
    """15 joints a person, one person after the other, whether named apart or not."""
    P = points(2 * PERSON)
    plain = [f"joint{k}" for k in range(PERSON)] * 2
    write_c3d(tmp_path / "umpm/p2_free_2_vm.c3d", P, plain)
    scene = load_take(tmp_path, "umpm", "p2_free_2_vm")
    assert scene.labels is not None and np.bincount(scene.labels).tolist() == [PERSON, PERSON]
    write_c3d(tmp_path / "umpm/q_vm.c3d", P, [f"{k // PERSON}:{name}" for k, name in enumerate(plain)])
    np.testing.assert_array_equal(load_take(tmp_path, "umpm", "q_vm").tracks, scene.tracks)
    write_c3d(tmp_path / "umpm/odd_vm.c3d", P[:, :, 1:], plain[1:])
    with pytest.raises(DatasetError, match="29 virtual markers are not 15 a person"):
        load_take(tmp_path, "umpm", "odd_vm")


def test_duplicate_labels(tmp_path: Path, write_c3d: WriteC3D) -> None:
    labels = [*LABELS[:3], LABELS[1], *LABELS[4:]]
    path = write_c3d(tmp_path / "umpm/p2_free_2.c3d", points(), labels)
    with pytest.raises(DatasetError, match="2 markers have the label 'LEFT:LWRTOP'; name them apart") as caught:
        registry.load_scene(SETTINGS, tmp_path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("unit", ["", "furlong", "MM"])
def test_unknown_unit(tmp_path: Path, write_c3d: WriteC3D, unit: str) -> None:
    write_c3d(tmp_path / "umpm/p2_free_2.c3d", points(), LABELS, unit=unit)
    with pytest.raises(DatasetError, match="unit of length"):
        registry.load_scene(SETTINGS, tmp_path)


def test_units_do_not_change_the_scene(take: Path, tmp_path: Path, write_c3d: WriteC3D) -> None:
    write_c3d(tmp_path / "umpm/metres.c3d", points() / 1024, LABELS, unit="m")
    one, other = (load_take(tmp_path, "umpm", name).tracks for name in ("p2_free_2", "metres"))
    np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.parametrize(
    ("labels", "sizes"),
    [
        (MARKERS, {"person": 37}),
        ([f"S:{m}" for m in MARKERS], {"S": 37}),
        ([*(f"a:b:{m}" for m in MARKERS), "*1", ""], {"a:b": 37}),
        ([*(f"S:{m}" for m in MARKERS), "loose"], {"S": 37}),
    ],
)
def test_who_is_a_person(labels: list[str], sizes: dict[str, int]) -> None:
    groups = bodies(Path("x.c3d"), labels)
    assert {body: len(markers) for body, markers in groups.items()} == sizes


@pytest.mark.parametrize(
    ("labels", "settings", "message"),
    [
        (MARKERS[:14], {}, "no 15 markers are one person's; its sets of markers are none"),
        ([], {}, "no 15 markers"),
        (PEOPLE, {"persons": ["MIDDLE"]}, "dataset.persons names 'MIDDLE'; its sets of markers are 'LEFT', 'RIGHT'"),
        (PEOPLE, {"persons": "LEFT"}, r"wanted a list such as \[LEFT\]"),
        (PEOPLE, {"others": "some"}, "dataset.others is 'some'"),
    ],
)
def test_no_such_people(labels: list[str], settings: dict[str, Any], message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        bodies(Path("x.c3d"), labels, **settings)


# Which frames


@pytest.mark.parametrize(
    ("thinning", "n_frames", "rate", "kept"),
    [
        (Thinning(), 400, 100.0, range(400)),
        (Thinning(), 401, 100.0, range(0, 401, 2)),
        (Thinning(video_rate=50.0), 11, 100.0, range(0, 11, 2)),
        (Thinning(video_rate=50.0, span=[1, 4]), 11, 100.0, range(2, 8, 2)),
        (Thinning(video_rate=50.0, stride=3), 12, 100.0, range(0, 12, 6)),
        (Thinning(video_rate=119.999), 5, 120.0, range(5)),
        (Thinning(most=10), 99, 30.0, range(0, 99, 10)),
    ],
)
def test_thinning(thinning: Thinning, n_frames: int, rate: float, kept: range) -> None:
    assert list(range(n_frames)[thinning.frames(n_frames, rate)]) == list(kept)


@pytest.mark.parametrize("n_frames", [2, 3, 7, 400, 401, 799, 1000, 5188])
@pytest.mark.parametrize("rate", [50.0, 100.0])
def test_thinning_keeps_at_most_what_is_asked(n_frames: int, rate: float) -> None:
    thinning = Thinning(video_rate=50.0, most=400)
    if rate == 100.0 and n_frames == 2:
        return  # one frame of video
    kept = range(n_frames)[thinning.frames(n_frames, rate)]
    assert 2 <= len(kept) <= 400 and kept.step % (rate / 50) == 0
    assert len(kept) > 200 or len(kept) == len(range(0, n_frames, int(rate / 50)))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"video_rate": 30.0}, "of which the markers' rate 100 is no multiple"),
        ({"video_rate": 200.0}, "no multiple"),
        ({"video_rate": -1.0}, "dataset.video_rate is -1.0"),
        ({"span": [0, 12]}, r"dataset.range is \[0, 12\], wanted \[first, last\] within 0..11"),
        ({"span": [3, 4]}, "dataset.range"),
        ({"span": [0.0, 4]}, "dataset.range"),
        ({"span": 4}, "dataset.range"),
        ({"stride": 0}, "dataset.stride"),
        ({"stride": 11}, "leaves one of 11 frames"),
        ({"most": 1}, "dataset.frames"),
        ({"least_seen": "all"}, "dataset.least_seen"),
    ],
)
def test_thinning_that_does_not_fit(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        Thinning(**settings).frames(11, 100.0)


@pytest.mark.data
def test_real_take(data_folder: Path) -> None:
    scene = load_take(data_folder, "c3d", "cmu_02_01", video_rate=60.0)
    assert (scene.n_frames, scene.n_points, scene.bodies) == (172, 41, ("TakeoMonday",))
    assert scene.structure is not None and spread(scene.structure) == pytest.approx(1)
