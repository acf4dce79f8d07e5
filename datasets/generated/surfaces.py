"""Generated surfaces, as dense as a video: a face moved by a few expressions, a beating heart.

Axes: x ahead, y to the left, z up, in metres.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array, Body
from nrsfm.datasets.generated.motion import VERSION, check_settings, rotations, signals

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


def face(n_points: int = 40, n_frames: int = 120, seed: int = 0) -> Body:
    """A face on a grid of rows and columns that talks, smiles, and moves its brows and lips.

    Points run row by row from the forehead down (the last row may be shorter); edges join neighbours on the grid.
    28,880 points are a grid of 190 rows and 152 columns. Settings and errors are those of
    :func:`nrsfm.datasets.generated.people.person`.
    """
    described = check_settings(n_points, n_frames, seed)
    rng = np.random.default_rng([2, seed])
    across, down, edges = _grid(n_points)
    azimuth, height = np.deg2rad(80) * across, np.deg2rad(68) * down
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
    a = 0.5 + 0.5 * signals(rng, 1 + len(modes), n_frames)
    strength = a[:, 1:] * rng.uniform(0.8, 1.2, len(modes))
    S = rest + np.einsum("fk,kip->fip", strength, np.stack(list(modes.values())))
    follows = np.cos(azimuth) / (1 + np.exp((v + 0.46) / 0.04))
    turn = np.zeros((n_frames, 3))
    turn[:, 1] = np.deg2rad(20) * a[:, 0]
    S += follows * ((rotations(turn) - np.eye(3)) @ rest)
    return Body("face", S, edges, digest=f"procedural:{VERSION}:face:{described}")


def heart(n_points: int = 40, n_frames: int = 120, seed: int = 0) -> Body:
    """The front of a beating heart on a grid: the upper chambers draw in, then the lower ones, which also twist.

    The whole swings with the breath. Without that, resting points of two bodies before one camera would move as one
    rigid body, and no method could tell them apart. Points, edges, settings and errors as for :func:`face`.
    """
    described = check_settings(n_points, n_frames, seed)
    rng = np.random.default_rng([4, seed])
    across, down, edges = _grid(n_points)
    azimuth, height = np.deg2rad(85) * across, np.deg2rad(75) * down
    width, depth, length = np.array([0.055, 0.045, 0.065]) * rng.uniform(0.93, 1.07, 3)
    v = np.sin(height)
    girth = np.cos(height) ** 0.8 * (1 + 0.25 * v)  # wider above, pointed below
    lean = 0.012 * (1 - v) ** 2  # the apex points to the left
    side = np.stack([depth * np.cos(azimuth), width * np.sin(azimuth), np.zeros_like(v)]) * girth
    rest = side + np.stack([np.zeros_like(v), lean, length * v])

    upper, lower = 1 / (1 + np.exp((0.3 - v) / 0.1)), 1 / (1 + np.exp((v - 0.2) / 0.1))
    valve = np.exp(-(((v - 0.25) / 0.15) ** 2))
    drawn = rng.uniform(0.8, 1.2, 4)
    a = signals(rng, 4, n_frames)
    modes = [
        -0.12 * upper * side,
        -0.16 * lower * side,
        0.008 * (lower - 0.5 * upper + 0.3 * valve) * np.array([[0.0], [0.0], [1.0]]),
        -0.006 * valve * np.array([[1.0], [0.3], [0.0]]),
    ]
    S = rest + np.einsum("fk,kip->fip", 0.5 + 0.5 * a * drawn, np.stack(modes))
    turn = np.zeros((n_frames, 3))
    turn[:, 2] = np.deg2rad(14) * (0.5 + 0.5 * a[:, 1])
    S += lower * (1 - v) / 2 * ((rotations(turn) - np.eye(3)) @ side)
    S = rotations(np.deg2rad(12) * signals(rng, 3, n_frames)) @ S
    return Body("heart", S, edges, digest=f"procedural:{VERSION}:heart:{described}")


SURFACES: Mapping[str, Callable[[int, int, int], Body]] = {"face": face, "heart": heart}


def _grid(n_points: int) -> tuple[Array, Array, NDArray[np.int64]]:
    """A grid of five rows for four columns: each point's place across and down, in (-1, 1), and the edges (E, 2)."""
    columns = max(1, round(np.sqrt(0.8 * n_points)))
    rows = -(-n_points // columns)
    index = np.arange(n_points)
    across = 2 * (index % columns + 0.5) / columns - 1
    down = 1 - 2 * (index // columns + 0.5) / rows
    right = index[(index % columns < columns - 1) & (index + 1 < n_points)]
    below = index[index + columns < n_points]
    edges = np.concatenate([np.column_stack([right, right + 1]), np.column_stack([below, below + columns])])
    return across, down, edges


def _bump(u: Array, v: Array, across: float, up: float, wide: float, high: float) -> Array:
    """A Gaussian bump (P,) on the face, the same on both sides."""
    return np.exp(-(((np.abs(u) - across) / wide) ** 2) - ((v - up) / high) ** 2)
