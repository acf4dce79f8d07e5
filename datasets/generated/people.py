"""People made from a seed: skeletons moved by forward kinematics.

Joint angles follow a handful of quasi-periodic signals, so that the shapes span a space of low dimension, as in
motion-capture takes. Axes: x ahead, y to the left, z up, in metres.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array, Body
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.generated.motion import VERSION, check_settings, rotations, signals

N_SIGNALS = 5
Limb = tuple[str, str, tuple[float, float, float], tuple[float, float, float]]

# Joint, parent, offset from it, radius of the limb at both ends and the share by which it is wider than deep.
_TRUNK: tuple[Limb, ...] = (
    ("pelvis", "", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ("spine", "pelvis", (-0.01, 0.0, 0.16), (0.11, 0.10, 0.4)),
    ("chest", "spine", (0.01, 0.0, 0.18), (0.10, 0.12, 0.4)),
    ("neck", "chest", (0.0, 0.0, 0.18), (0.12, 0.05, 0.4)),
    ("head", "neck", (0.02, 0.0, 0.15), (0.05, 0.10, -0.2)),
    ("crown", "head", (0.0, 0.0, 0.13), (0.10, 0.05, -0.2)),
)

_SIDE: tuple[Limb, ...] = (
    ("shoulder", "chest", (0.0, 0.18, 0.14), (0.07, 0.06, 0.0)),
    ("elbow", "shoulder", (0.0, 0.03, -0.29), (0.055, 0.04, 0.0)),
    ("wrist", "elbow", (0.02, 0.01, -0.25), (0.04, 0.028, 0.0)),
    ("hand", "wrist", (0.01, 0.0, -0.12), (0.03, 0.02, 0.0)),
    ("hip", "pelvis", (0.0, 0.10, -0.06), (0.10, 0.09, 0.0)),
    ("knee", "hip", (0.01, 0.0, -0.42), (0.085, 0.055, 0.0)),
    ("ankle", "knee", (-0.02, 0.0, -0.41), (0.055, 0.035, 0.0)),
    ("toe", "ankle", (0.17, 0.02, -0.06), (0.04, 0.03, 0.3)),
)

# Joint, axis, degrees at rest, degrees of swing, signal. Turns are positive forward about y and leftward about z;
# about x they lift a limb away from the body. A joint of both sides moves on both, in turn where `~` stands before it.
ACTIVITIES: Mapping[str, str] = {
    "walk": "~hip y -8 30 0, ~knee y 30 25 1, ~shoulder y 0 -28 0, elbow y -30 15 2, chest z 0 8 0, spine y 4 5 3,"
    " neck z 0 15 4",
    "wave": "left_shoulder x 120 25 0, left_elbow x 35 35 1, right_shoulder y -15 20 2, right_elbow y -40 25 2,"
    " spine x 0 10 3, neck z 0 20 4, ~knee y 12 10 3, ~hip y -6 5 3",
    "bend": "spine y 25 25 0, chest y 12 12 0, hip y -35 30 1, knee y 45 38 1, ankle y -15 12 1, shoulder y -45 30 2,"
    " elbow y -25 20 3, chest z 0 12 4",
    "stretch": "shoulder x 100 50 0, elbow x 20 18 1, spine x 0 18 2, chest x 0 12 2, chest z 0 20 3, knee y 15 12 4,"
    " hip y -8 6 4",
    "dance": "~shoulder x 55 35 0, ~shoulder y -20 30 1, ~elbow y -50 30 2, ~hip y -15 22 3, ~knee y 35 28 3,"
    " spine x 0 12 0, chest z 0 14 4, neck y 0 12 2",
    "drink": "right_shoulder y -45 35 0, right_elbow y -70 45 0, right_shoulder x 12 15 1, left_shoulder y -10 15 2,"
    " left_elbow y -30 20 2, neck y -5 18 3, chest z 0 12 4, spine y 3 6 4",
}


def person(n_points: int = 41, n_frames: int = 120, seed: int = 0, activity: str | None = None) -> Body:
    """A person who moves the limbs and stays in one place.

    Parameters
    ----------
    n_points : int
        At least 2. The joints come first, then markers on the limbs' skin, each rigid to its bone. Fewer points than
        joints are joints, evenly chosen. The first markers do not depend on how many there are.
    n_frames : int
        At least 2, 1/30 s apart; frames for less than four seconds are spread over four seconds.
    seed : int
        At least 0; decides proportions, tempo and manner.
    activity : str, optional
        One of :data:`ACTIVITIES`; by default the seed chooses.

    Returns
    -------
    Body
        Edges are the bones, and from each marker to its nearer joint.

    Raises
    ------
    DatasetError
        If a setting is out of range.
    """
    described = check_settings(n_points, n_frames, seed)
    activity = activity or activity_of(seed)
    if activity not in ACTIVITIES:
        raise DatasetError(f"activity is {activity!r}, wanted one of {', '.join(ACTIVITIES)}")
    rng = np.random.default_rng([1, seed])
    names, parents, offsets, radii = _skeleton(rng)

    # Forward kinematics: G turns a joint's frame into the world's, x is where the joint stands.
    R = rotations(_angles(rng, activity, names, n_frames))
    G, x = R.copy(), np.zeros((n_frames, len(names), 3))
    for j, p in enumerate(parents[1:], start=1):
        G[:, j] = G[:, p] @ R[:, j]
        x[:, j] = x[:, p] + G[:, p] @ offsets[j]

    bones = np.column_stack([parents[1:], np.arange(1, len(names))])
    S, edges = x.transpose(0, 2, 1), bones
    if n_points > len(names):
        child, along, local = _markers(n_points - len(names), offsets, radii)
        frame = parents[child]
        markers = np.empty((n_frames, 3, len(child)))
        for p in np.unique(frame):
            of_bone = frame == p
            markers[:, :, of_bone] = x[:, p, :, None] + G[:, p] @ local[of_bone].T
        S = np.concatenate([S, markers], axis=2)
        nearer = np.where(along < 0.5, frame, child)
        edges = np.concatenate([bones, np.column_stack([nearer, np.arange(len(names), n_points)])])
    elif n_points < len(names):
        kept = np.linspace(0, len(names) - 1, n_points).round().astype(int)
        nearest = np.zeros_like(parents)  # of the kept joints, on the way to the pelvis
        for j, p in enumerate(parents):
            nearest[j] = np.searchsorted(kept, j) if j in kept else nearest[p]
        S, edges = S[:, :, kept], np.column_stack([nearest[parents[kept[1:]]], np.arange(1, n_points)])
    digest = f"procedural:{VERSION}:person:{described}:activity={activity}"
    return Body("person", np.ascontiguousarray(S), edges, digest=digest)


def activity_of(seed: int, nth: int = 0) -> str:
    """The activity of the nth person of a scene: one after the other of a random order."""
    order: list[int] = np.random.default_rng([3, seed]).permutation(len(ACTIVITIES)).tolist()
    return list(ACTIVITIES)[order[nth % len(order)]]


def _skeleton(rng: np.random.Generator) -> tuple[list[str], NDArray[np.int64], Array, Array]:
    """Names, parents (J,), offsets (J, 3) and radii (J, 3) of all joints, parents before children."""
    limbs = list(_TRUNK)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for joint, parent, (x, y, z), radius in _SIDE:
            above = parent if parent in ("chest", "pelvis") else f"{side}_{parent}"
            limbs.append((f"{side}_{joint}", above, (x, sign * y, z), radius))
    names = [limb[0] for limb in limbs]
    parents = np.array([names.index(limb[1] or limb[0]) for limb in limbs])
    kinds = [name.partition("_")[2] or name for name in names]
    size = dict(zip(dict.fromkeys(kinds), rng.uniform(0.93, 1.07, len(names)), strict=False))
    scale = np.array([size[kind] for kind in kinds])[:, None]
    return names, parents, scale * [limb[2] for limb in limbs], np.array([limb[3] for limb in limbs])


def _angles(rng: np.random.Generator, activity: str, names: list[str], n_frames: int) -> Array:
    """Rotation vectors (F, J, 3) in radians: the activity's swings, and a little of every signal in every joint."""
    swings = signals(rng, N_SIGNALS, n_frames)
    v = np.einsum("fk,kji->fji", swings, rng.normal(0, 1.5, (N_SIGNALS, len(names), 3)))
    for text in ACTIVITIES[activity].split(","):
        joint, letter, rest, swing, k = text.split()
        plain, axis = joint.removeprefix("~"), "xyz".index(letter)
        moved = float(rest) + float(swing) * rng.uniform(0.6, 1.0) * swings[:, int(k)]
        turned = 2 * float(rest) - moved if joint.startswith("~") else moved
        for name, angle in ((plain, moved), (f"left_{plain}", moved), (f"right_{plain}", turned)):
            if name in names:
                v[:, names.index(name), axis] += -angle if axis != 1 and name.startswith("right") else angle
    return np.asarray(np.deg2rad(v))


def _markers(n: int, offsets: Array, radii: Array) -> tuple[NDArray[np.int64], Array, Array]:
    """Points on the skin: child joint (n,), share along the bone (n,) and place in the parent's frame (n, 3).

    The points are an even, low-discrepancy sequence over the unrolled skin (Roberts' R2).
    """
    length = np.linalg.norm(offsets, axis=1)
    area = np.cumsum(length * radii[:, :2].mean(axis=1))
    s, turn = (0.5 + np.arange(1, n + 1)[:, None] * [0.7548776662466927, 0.5698402909980532]).T % 1
    child = np.searchsorted(area, s * area[-1], side="right")
    along = 1 - (area[child] - s * area[-1]) / (area[child] - area[child - 1])
    bone = offsets[child] / length[child, None]
    across = np.cross(bone, [1.0, 0.0, 0.0])  # no bone points straight ahead
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    start, end, wider = radii[child].T[:, :, None]
    radius = start + along[:, None] * (end - start)
    deep = radius * np.cos(2 * np.pi * turn)[:, None] * np.cross(across, bone)
    wide = radius * (1 + wider) * np.sin(2 * np.pi * turn)[:, None] * across
    return child, along, along[:, None] * offsets[child] + deep + wide
