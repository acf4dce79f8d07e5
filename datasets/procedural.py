"""People and faces made from a seed: the data that is always there.

A person is a skeleton moved by forward kinematics whose joint angles follow a handful of quasi-periodic signals, so
that its shapes span a space of low dimension, as in motion-capture takes; a face is a smooth surface moved by a few
expressions. Neither turns as a whole. Axes: x ahead, y to the left, z up, in metres. Same settings, same numbers.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datasets.body import Array, Body, DatasetError
from datasets.scene import Scene, compose

VERSION = "v1"
KINDS = ("person", "face")
FACES = ("face", "shark")  # sequences whose stand-in is a surface
FRAMES_PER_SECOND, SHORTEST_SECONDS = 30.0, 4.0
LARGEST = 10**8  # points times frames of one body: 2.4 GB
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

# Height above the face's ellipsoid in metres, then where: across and up in shares of the face's half width and half
# length, and the bump's radii there. Across is taken on both sides.
_RELIEF = (
    (0.024, 0.0, -0.10, 0.17, 0.13),  # tip of the nose
    (0.014, 0.0, 0.16, 0.13, 0.24),  # its bridge
    (-0.010, 0.42, 0.24, 0.24, 0.12),  # sockets
    (0.005, 0.42, 0.23, 0.14, 0.07),  # eyes
    (0.006, 0.40, 0.44, 0.36, 0.08),  # brows
    (0.007, 0.0, -0.38, 0.36, 0.05),  # upper lip
    (-0.005, 0.0, -0.46, 0.40, 0.03),  # between the lips
    (0.007, 0.0, -0.54, 0.32, 0.05),  # lower lip
    (0.010, 0.0, -0.84, 0.30, 0.14),  # chin
    (0.006, 0.58, -0.08, 0.26, 0.26),  # cheeks
)
# Expression, its shift in metres ahead, outward and up, and where, as above.
_EXPRESSIONS = (
    ("smile", -0.006, 0.012, 0.010, 0.38, -0.45, 0.25, 0.16),
    ("smile", 0.005, 0.0, 0.006, 0.58, -0.08, 0.28, 0.22),
    ("brows", 0.002, 0.0, 0.012, 0.40, 0.46, 0.45, 0.16),
    ("pucker", 0.012, 0.0, 0.0, 0.0, -0.46, 0.26, 0.14),
    ("pucker", 0.0, -0.012, 0.0, 0.36, -0.46, 0.22, 0.14),
    ("squint", 0.003, 0.0, -0.006, 0.42, 0.36, 0.3, 0.10),
    ("squint", 0.003, 0.0, 0.006, 0.42, 0.12, 0.3, 0.10),
)


def person(n_points: int = 41, n_frames: int = 120, seed: int = 0, activity: str | None = None) -> Body:
    """A person who stays where he stands and moves his limbs.

    Parameters
    ----------
    n_points : int
        At least 2. The joints come first (fewer points than joints: an even choice of them), then markers on the
        limbs' skin, each rigid to its bone; the first markers stay the same when more are asked for.
    n_frames : int
        At least 2, 1/30 s apart; less than four seconds' worth are spread over four seconds.
    seed : int
        At least 0: proportions, tempo and manner.
    activity : str, optional
        One of :data:`ACTIVITIES`; chosen by the seed when it is not given.

    Returns
    -------
    Body
        Edges are the bones, and from each marker to its nearer joint.

    Raises
    ------
    DatasetError
        If a setting is out of range.
    """
    settings = _settings(n_points, n_frames, seed)
    activity = activity or _activity(seed)
    if activity not in ACTIVITIES:
        raise DatasetError(f"activity is {activity!r}, wanted one of {', '.join(ACTIVITIES)}")
    rng = np.random.default_rng([1, seed])
    names, parents, offsets, radii = _skeleton(rng)

    # Forward kinematics: G turns a joint's frame into the world's, x is where the joint stands.
    R = _rotations(_angles(rng, activity, names, n_frames))
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
            mine = frame == p
            markers[:, :, mine] = x[:, p, :, None] + G[:, p] @ local[mine].T
        S = np.concatenate([S, markers], axis=2)
        nearer = np.where(along < 0.5, frame, child)
        edges = np.concatenate([bones, np.column_stack([nearer, np.arange(len(names), n_points)])])
    elif n_points < len(names):
        kept = np.linspace(0, len(names) - 1, n_points).round().astype(int)
        nearest = np.zeros_like(parents)  # of the kept joints, on the way to the pelvis
        for j, p in enumerate(parents):
            nearest[j] = np.searchsorted(kept, j) if j in kept else nearest[p]
        S, edges = S[:, :, kept], np.column_stack([nearest[parents[kept[1:]]], np.arange(1, n_points)])
    digest = f"procedural:{VERSION}:person:{settings}:activity={activity}"
    return Body("person", np.ascontiguousarray(S), edges, digest=digest)


def face(n_points: int = 40, n_frames: int = 120, seed: int = 0) -> Body:
    """A face on a grid of rows and columns that talks, smiles, and moves its brows and lips.

    Points run row by row from the forehead down (the last row may be shorter); edges join neighbours on the grid.
    Settings and errors are those of :func:`person`.
    """
    settings = _settings(n_points, n_frames, seed)
    rng = np.random.default_rng([2, seed])
    columns = max(1, round(np.sqrt(0.8 * n_points)))
    rows = -(-n_points // columns)
    index = np.arange(n_points)
    azimuth = np.deg2rad(80) * (2 * (index % columns + 0.5) / columns - 1)
    height = np.deg2rad(68) * (1 - 2 * (index // columns + 0.5) / rows)
    width, depth, length = np.array([0.08, 0.095, 0.105]) * rng.uniform(0.93, 1.07, 3)
    x = depth * np.cos(height) ** 0.7 * np.cos(azimuth)
    y = width * np.cos(height) ** 0.6 * np.sin(azimuth) * (1 + 0.1 * np.sin(height))
    u, v = y / width, np.sin(height)
    for share, (bulge, *where) in zip(rng.uniform(0.8, 1.2, len(_RELIEF)), _RELIEF, strict=True):
        x += share * bulge * _bump(u, v, *where)
    rest = np.stack([x, y, length * v])

    # Expressions are added to the face at rest; the jaw turns about the ears, and skin follows it below the lips.
    modes: dict[str, Array] = {}
    for expression, ahead, outward, up, *where in _EXPRESSIONS:
        shift = np.stack([np.full_like(u, ahead), outward * np.tanh(u / 0.1), np.full_like(u, up)])
        modes[expression] = modes.get(expression, 0.0) + shift * _bump(u, v, *where)
    a = 0.5 + 0.5 * _signals(rng, 1 + len(modes), n_frames)
    strength = a[:, 1:] * rng.uniform(0.8, 1.2, len(modes))
    S = rest + np.einsum("fk,kip->fip", strength, np.stack(list(modes.values())))
    follows = np.cos(azimuth) / (1 + np.exp((v + 0.46) / 0.04))
    turn = np.zeros((n_frames, 3))
    turn[:, 1] = np.deg2rad(20) * a[:, 0]
    S += follows * ((_rotations(turn) - np.eye(3)) @ rest)

    right = index[(index % columns < columns - 1) & (index + 1 < n_points)]
    below = index[index + columns < n_points]
    edges = np.concatenate([np.column_stack([right, right + 1]), np.column_stack([below, below + columns])])
    return Body("face", S, edges, digest=f"procedural:{VERSION}:face:{settings}")


def bodies(kinds: Sequence[str], n_points: int | Sequence[int], n_frames: int, seed: int = 0) -> list[Body]:
    """Bodies for one scene, with names of their own (person, person_2, face) and people at different activities.

    ``n_points`` is for all bodies, or one number a body; the rest is as for :func:`person`. Raises DatasetError
    if a setting is out of range, naming it as the configuration does.
    """
    if not _listed(kinds) or not kinds or any(kind not in KINDS for kind in kinds):
        raise DatasetError(f"dataset.bodies is {kinds!r}, wanted a list of {' and '.join(KINDS)}")
    counts: list[Any] = (
        list(n_points) if isinstance(n_points, Sequence) and _listed(n_points) else [n_points] * len(kinds)
    )
    if len(counts) != len(kinds):
        raise DatasetError(f"dataset.points holds {len(counts)} numbers for {len(kinds)} bodies; wanted one for each")
    made: list[Body] = []
    for k, (kind, count) in enumerate(zip(kinds, counts, strict=True)):
        _settings(count, n_frames, seed)
        nth = sum(kind == other for other in kinds[:k])
        own = seed if k == 0 else int(np.random.SeedSequence([seed, k]).generate_state(1)[0])
        body = person(count, n_frames, own, _activity(seed, nth)) if kind == "person" else face(count, n_frames, own)
        made.append(replace(body, name=f"{kind}_{nth + 1}" if nth else kind))
    return made


def stand_in(name: str, n_frames: int, n_points: int, kind: str | None = None) -> Body:
    """A body in the place of a sequence that is absent: of its name and size, and marked as a stand-in.

    The seed comes from the name; ``kind`` is a face for :data:`FACES`, else a person, when it is not given.
    """
    kind = kind or ("face" if name in FACES else "person")
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "little")
    return replace(bodies([kind], n_points, n_frames, seed)[0], name=name, stand_in=True)


def load_scene(kinds: Sequence[str], points: int | Sequence[int], frames: int, seed: int, **placement: Any) -> Scene:
    """A scene of generated bodies; ``placement`` goes to :func:`datasets.scene.compose`."""
    return compose(bodies(kinds, points, frames, seed), **placement)


def _listed(value: object) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _settings(n_points: int, n_frames: int, seed: int) -> str:
    """Check the settings, and print them as the digest has them."""
    for key, value, least in (("points", n_points, 2), ("frames", n_frames, 2), ("seed", seed, 0)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise DatasetError(f"dataset.{key} is {value!r}, wanted a whole number of at least {least}")
    if int(n_frames) * max(int(n_points), 300) > LARGEST:
        raise DatasetError(f"dataset.points x dataset.frames is {n_points} x {n_frames}, wanted at most {LARGEST:.0e}")
    return f"points={n_points}:frames={n_frames}:seed={seed}"


def _activity(seed: int, nth: int = 0) -> str:
    """The seed's activity for the nth person of a scene: different ones until all have had their turn."""
    order = np.random.default_rng([3, seed]).permutation(len(ACTIVITIES))
    return list(ACTIVITIES)[order[nth % len(order)]]


def _signals(rng: np.random.Generator, n: int, n_frames: int) -> Array:
    """(F, n) quasi-periodic signals within [-1, 1]: a tempo, nearly its double, and a slow drift each."""
    seconds = max((n_frames - 1) / FRAMES_PER_SECOND, SHORTEST_SECONDS)
    t = np.linspace(0, seconds, n_frames)[:, None, None]
    tempo = rng.uniform(0.25, 0.6, n)
    frequency = np.stack([tempo, tempo * rng.uniform(1.9, 2.1, n), tempo * rng.uniform(0.2, 0.5, n)])
    waves = np.sin(2 * np.pi * (frequency * t + rng.uniform(0, 1, (3, n))))
    return np.einsum("h,fhn->fn", [0.65, 0.2, 0.15], waves)


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
    """(F, J, 3) rotation vectors in radians: the activity's swings, and a little of every signal in every joint."""
    signals = _signals(rng, N_SIGNALS, n_frames)
    v = np.einsum("fk,kji->fji", signals, rng.normal(0, 1.5, (N_SIGNALS, len(names), 3)))
    for text in ACTIVITIES[activity].split(","):
        joint, letter, rest, swing, k = text.split()
        plain, axis = joint.removeprefix("~"), "xyz".index(letter)
        moved = float(rest) + float(swing) * rng.uniform(0.6, 1.0) * signals[:, int(k)]
        turned = 2 * float(rest) - moved if joint.startswith("~") else moved
        for name, angle in ((plain, moved), (f"left_{plain}", moved), (f"right_{plain}", turned)):
            if name in names:
                v[:, names.index(name), axis] += -angle if axis != 1 and name.startswith("right") else angle
    return np.deg2rad(v)


def _rotations(v: Array) -> Array:
    """Rodrigues' formula: (..., 3) rotation vectors to (..., 3, 3) rotations."""
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    K = np.cross(v[..., None, :], np.eye(3)).swapaxes(-1, -2)
    return np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (K @ K)


def _markers(n: int, offsets: Array, radii: Array) -> tuple[NDArray[np.int64], Array, Array]:
    """Child joint (n,), share along the bone (n,) and place in the parent's frame (n, 3) of points on the skin.

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


def _bump(u: Array, v: Array, across: float, up: float, wide: float, high: float) -> Array:
    """(P,) Gaussian on the face, the same on both sides."""
    return np.exp(-(((np.abs(u) - across) / wide) ** 2) - ((v - up) / high) ** 2)
