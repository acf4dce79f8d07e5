"""Generated bodies: the same numbers every time, moving like the real ones, and bodies of their own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nrsfm.datasets.body import Array, Body, centre, spread
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.generated.motion import VERSION, rotations
from nrsfm.datasets.generated.people import ACTIVITIES, N_SIGNALS, _skeleton, person
from nrsfm.datasets.generated.procedural import bodies, load_scene, stand_in
from nrsfm.datasets.generated.surfaces import face, heart
from nrsfm.datasets.registration import procrustes

N_JOINTS = 22
SEEDS = range(6)


def rank(M: Array, energy: float) -> int:
    """How many singular values hold that share of the sum of squares."""
    s = np.linalg.svd(M, compute_uv=False) ** 2
    return int(np.searchsorted(np.cumsum(s) / s.sum(), energy)) + 1


def deformation(body: Body) -> Array:
    """(F, 3P): what is left of every frame's centred shape without the mean shape."""
    shapes = centre(body.structure).reshape(body.n_frames, -1)
    return np.asarray(shapes - shapes.mean(axis=0))


def people() -> list[Body]:
    return [person(41, 120, seed, activity) for seed in SEEDS[:2] for activity in ACTIVITIES]


def faces() -> list[Body]:
    return [face(60, 120, seed) for seed in SEEDS]


# Reproducibility


def test_the_numbers_are_pinned() -> None:
    """Results on file were measured on these bodies: a change of the numbers needs a new VERSION."""
    assert VERSION == "v1"
    hand_and_marker = [
        [0.474524896813, 0.272981541709, -0.001916897994],
        [0.035640507710, 0.101969012104, 0.473212202623],
    ]
    brow_and_chin = [
        [0.075763795986, 0.016311357002, 0.070691465664],
        [0.023028536363, -0.057527962318, -0.070681939578],
    ]
    np.testing.assert_allclose(person(41, 120, 0).structure[17][:, [9, 30]].T, hand_and_marker, atol=1e-9)
    np.testing.assert_allclose(face(40, 120, 0).structure[17][:, [9, 30]].T, brow_and_chin, atol=1e-9)


def test_the_same_settings_give_the_same_body() -> None:
    for make in (person, face):
        first, again = make(50, 40, 3), make(50, 40, 3)
        np.testing.assert_array_equal(first.structure, again.structure)
        np.testing.assert_array_equal(first.edges, again.edges)
        assert first.digest == again.digest


def test_every_setting_is_in_the_digest() -> None:
    made = [person(), person(42), person(n_frames=121), person(seed=1), person(activity="walk"), face(41), face()]
    made += [person(activity="wave")]
    assert len({b.digest for b in made}) == len(made)
    assert all(b.digest.startswith("procedural:v1:") and " " not in b.digest for b in made)


def test_more_points_leave_the_first_ones_in_place() -> None:
    few, many = person(30, 50, 2), person(300, 50, 2)
    np.testing.assert_allclose(few.structure, many.structure[:, :, :30], atol=1e-12)


def test_more_frames_go_on_from_the_first_ones() -> None:
    """From four seconds on; shorter sequences are spread over four seconds."""
    short, long = person(30, 150, 2), person(30, 300, 2)
    np.testing.assert_allclose(short.structure, long.structure[:150], atol=1e-12)


# A person's anatomy


def test_rotations_agree_with_a_reference() -> None:
    v = np.random.default_rng(0).normal(0, 2, (50, 3))
    v[0], v[1] = 0, 1e-9
    np.testing.assert_allclose(rotations(v), Rotation.from_rotvec(v).as_matrix(), atol=1e-12)


@pytest.mark.parametrize("activity", ACTIVITIES)
def test_bones_keep_their_length_and_markers_their_bone(activity: str) -> None:
    body = person(200, 120, 1, activity)
    i, j = body.edges.T
    length = np.linalg.norm(body.structure[:, :, i] - body.structure[:, :, j], axis=1)
    assert length.std(axis=0).max() < 1e-12
    assert length[:, : N_JOINTS - 1].min() > 0.02 and length.max() < 0.6, "metres"


@pytest.mark.parametrize("activity", ACTIVITIES)
def test_people_stand_upright_and_do_not_turn_round(activity: str) -> None:
    for seed in SEEDS:
        S = person(41, 300, seed, activity).structure
        crown, toes = S[:, :, 5], S[:, :, [13, 21]]
        assert (crown[:, 2] - toes[:, 2].max(axis=1) > 0.6).all()
        assert 1.4 < np.median(crown[:, 2] - toes[:, 2].min(axis=1)) < 2.0
        shoulders = S[:, :2, 6] - S[:, :2, 14]  # left minus right: along y
        yaw = np.rad2deg(np.arctan2(-shoulders[:, 0], shoulders[:, 1]))
        assert np.abs(yaw).max() < 60 and abs(yaw.mean()) < 15


def test_left_and_right_are_mirror_images_at_rest() -> None:
    names, parents, offsets, radii = _skeleton(np.random.default_rng(0))
    left = [k for k, name in enumerate(names) if name.startswith("left")]
    right = [names.index(names[k].replace("left", "right")) for k in left]
    assert len(names) == N_JOINTS and (parents[1:] < np.arange(1, N_JOINTS)).all()
    np.testing.assert_array_equal(offsets[left] * [1, -1, 1], offsets[right])
    np.testing.assert_array_equal(radii[left], radii[right])


def test_every_swing_names_a_joint() -> None:
    names = _skeleton(np.random.default_rng(0))[0]
    plain = {name.partition("_")[2] for name in names} | set(names)
    for swings in ACTIVITIES.values():
        for swing in swings.split(","):
            joint, axis, _, _, signal = swing.split()
            assert joint.removeprefix("~") in plain and axis in "xyz" and 0 <= int(signal) < N_SIGNALS


# A face's surface


def test_a_dense_face_is_a_full_grid() -> None:
    body = face(28_880, 99, 0)
    columns, rows = 152, 190
    assert len(body.edges) == rows * (columns - 1) + columns * (rows - 1)
    S = body.structure.reshape(99, 3, rows, columns)
    assert (np.diff(S[0, 2], axis=0) < 0).mean() > 0.99, "rows run downward"
    assert (np.diff(S[0, 1], axis=1) > 0).mean() > 0.99, "columns run to the face's left"
    nose = np.unravel_index(S[0, 0].argmax(), (rows, columns))
    assert abs(nose[1] - columns / 2) < 3 and 0.4 < nose[0] / rows < 0.7, "the nose is the foremost point"
    side = np.linalg.norm(body.structure[:, :, body.edges[:, 0]] - body.structure[:, :, body.edges[:, 1]], axis=1)
    assert side.max() < 0.02


def test_a_face_is_symmetric() -> None:
    S = face(152 * 190, 10, 4).structure.reshape(10, 3, 190, 152)
    np.testing.assert_allclose(S * np.array([1, -1, 1])[:, None, None], S[..., ::-1], atol=1e-12)


def test_a_dense_heart_is_a_full_grid_of_its_own_shape() -> None:
    body = heart(152 * 190, 10, 0)
    S = body.structure.reshape(10, 3, 190, 152)
    assert (np.diff(S[0, 2], axis=0) < 0).mean() > 0.99, "rows run downward"
    side = np.linalg.norm(body.structure[:, :, body.edges[:, 0]] - body.structure[:, :, body.edges[:, 1]], axis=1)
    assert side.max() < 0.01
    girth = np.ptp(S[0, 1], axis=1)
    assert girth[50] > 1.3 * girth[140], "pointed below"


def test_a_heart_beats_above_and_below_at_times_of_their_own() -> None:
    S = heart(2000, 300, 0).structure
    width = np.ptp(S[:, 1].reshape(300, 50, 40), axis=2)
    above, below = width[:, 10], width[:, 40]
    assert np.ptp(above) > 0.05 * above.mean() and np.ptp(below) > 0.05 * below.mean()
    assert abs(np.corrcoef(above, below)[0, 1]) < 0.7


# Motion


def test_people_deform_as_mocap_people_do() -> None:
    for body in people():
        M = deformation(body)
        assert 5 <= rank(M, 0.999) <= 12, body.digest
        assert rank(M, 0.99) >= 4, body.digest
        still = procrustes(body.structure)
        moved = np.linalg.norm(still - still.mean(axis=0)) / np.linalg.norm(still)
        assert 0.05 < moved < 0.35, body.digest


def test_faces_deform_by_a_few_expressions() -> None:
    for body in faces():
        assert 3 <= rank(deformation(body), 0.999) <= 6, body.digest
        assert np.linalg.svd(deformation(body), compute_uv=False)[7] < 1e-9, "six expressions' worth and no more"


def test_hearts_swing_and_deform_by_a_few_modes() -> None:
    for seed in SEEDS:
        body = heart(60, 120, seed)
        still = procrustes(body.structure).reshape(120, -1)
        still = still - still.mean(axis=0)
        assert 2 <= rank(still, 0.999) <= 8
        assert np.linalg.norm(still) < 0.8 * np.linalg.norm(deformation(body))


def test_motion_is_smooth() -> None:
    """Each frame lies near the middle of its neighbours, against how far the body moves at all."""
    for body in [*people(), *faces()]:
        S = body.structure
        off = S[1:-1] - (S[:-2] + S[2:]) / 2
        assert np.sqrt((off**2).mean()) < 0.05 * np.sqrt(((S - S.mean(axis=0)) ** 2).mean())


def test_trajectories_span_far_more_than_a_rigid_body_would() -> None:
    """A rigid body that rests has trajectories of dimension 3."""
    for body in [*people(), *faces()]:
        M = centre(body.structure).reshape(3 * body.n_frames, -1)
        s = np.linalg.svd(M, compute_uv=False)
        assert (s > 1e-4 * s[0]).sum() >= 8, body.digest


@pytest.mark.parametrize("kinds", [["person", "person"], ["person", "face"], ["face", "face"], ["face", "heart"]])
def test_two_bodies_move_in_subspaces_of_their_own(kinds: list[str]) -> None:
    """Principal angles between the trajectories' spaces, as far apart as those of the paper's pairs."""
    for seed in SEEDS:
        bases = []
        for body in bodies(kinds, 60, 120, seed):
            M = deformation(body).reshape(3 * body.n_frames, -1)
            bases.append(np.linalg.svd(M, full_matrices=False)[0][:, : rank(M, 0.99)])
        cosines = np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)
        assert cosines.max() < 0.995 and (cosines**2).mean() < 0.7


# Any size, any number


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(["person", "face", "heart"]), st.integers(2, 120), st.integers(2, 40), st.integers(0, 2**40))
def test_any_size_gives_a_sound_body(kind: str, n_points: int, n_frames: int, seed: int) -> None:
    [body] = bodies([kind], n_points, n_frames, seed)
    assert body.structure.shape == (n_frames, 3, n_points) and body.structure.flags.c_contiguous
    assert spread(body.structure) > 0 and body.vertical == "z" and not body.stand_in
    edges = body.edges
    assert edges.dtype.kind == "i" and (edges[:, 0] != edges[:, 1]).all()
    assert len({tuple(sorted(e)) for e in edges.tolist()}) == len(edges)
    reached, n = np.arange(n_points), 0
    while n < n_points:  # the graph hangs together: the smallest index spreads along the edges to all points
        np.minimum.at(reached, edges.ravel(), np.repeat(reached[edges].min(axis=1), 2))
        n += 1
    assert (reached == 0).all()


def test_names_are_unique_and_people_do_different_things() -> None:
    made = bodies(["person", "face", "person", "person", "face"], 30, 20, 1)
    assert [b.name for b in made] == ["person", "face", "person_2", "person_3", "face_2"]
    activities = [b.digest.rpartition("=")[2] for b in made if b.name.startswith("person")]
    assert len(set(activities)) == 3
    assert len({b.structure.tobytes() for b in made}) == 5
    np.testing.assert_array_equal(made[0].structure, person(30, 20, 1).structure)


def test_points_one_number_a_body() -> None:
    assert [b.n_points for b in bodies(["face", "person", "face"], [25, 41, 7], 10)] == [25, 41, 7]


def test_many_bodies() -> None:
    assert len({b.structure.tobytes() for b in bodies(["person"] * 9, 25, 10)}) == 9


def test_scene() -> None:
    scene = load_scene(["person", "face", "person"], [41, 40, 30], 50, 2, placement="intersecting", name="crowd")
    assert scene.name == "crowd" and scene.n_frames == 50 and scene.n_bodies == 3 and not scene.stand_in
    assert scene.labels is not None and np.bincount(scene.labels).tolist() == [41, 40, 30]
    again = load_scene(["person", "face", "person"], [41, 40, 30], 50, 2, placement="intersecting")
    np.testing.assert_array_equal(scene.tracks, again.tracks)
    assert scene.digest == again.digest


# Stand-ins


@pytest.mark.parametrize(
    ("name", "kind"), [("drink", "person"), ("dance", "person"), ("face", "face"), ("shark", "face")]
)
def test_stand_in(name: str, kind: str) -> None:
    body = stand_in(name, 264, 75)
    assert body.name == name and body.stand_in and body.structure.shape == (264, 3, 75)
    assert f":{kind}:" in body.digest


def test_stand_ins_differ_by_name() -> None:
    names = ["drink", "pickup", "yoga", "stretch", "dance", "walking"]
    assert len({stand_in(name, 20, 41).structure.tobytes() for name in names}) == len(names)


# Wrong settings


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"points": 0}, "points"),
        ({"points": 1}, "points"),
        ({"points": -3}, "points"),
        ({"points": 2.5}, "points"),
        ({"points": True}, "points"),
        ({"points": "many"}, "points is 'many'"),
        ({"points": None}, "points"),
        ({"points": [41]}, "points"),
        ({"points": [41, 0]}, "points"),
        ({"points": 10**12}, "points"),
        ({"frames": -1}, "frames"),
        ({"frames": 0}, "frames"),
        ({"frames": 1}, "frames"),
        ({"frames": 10**9}, "frames"),
        ({"frames": None}, "frames"),
        ({"seed": -1}, "seed"),
        ({"seed": 0.5}, "seed"),
        ({"kinds": []}, "bodies"),
        ({"kinds": ["person", "horse"]}, "bodies"),
        ({"kinds": "person"}, "bodies is 'person'"),
        ({"kinds": [["person"]]}, "bodies"),
        ({"kinds": None}, "bodies"),
        ({"kinds": 3}, "bodies"),
    ],
)
def test_wrong_settings(changes: dict[str, Any], key: str) -> None:
    given_: dict[str, Any] = {"kinds": ["person", "face"], "points": 40, "frames": 30, "seed": 0, **changes}
    with pytest.raises(DatasetError, match=rf"dataset\.{key}") as caught:
        load_scene(**given_)
    assert "\n" not in str(caught.value)


def test_unknown_activity() -> None:
    with pytest.raises(DatasetError, match="activity is 'swim'"):
        person(activity="swim")
