"""One deforming body: its points in 3D over time, before it is placed in a scene."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.errors import DatasetError

Array = NDArray[np.float64]


def no_edges() -> NDArray[np.int64]:
    return np.zeros((0, 2), dtype=np.int64)


@dataclass(frozen=True)
class Body:
    """A single body in the units and axes of its source.

    Parameters
    ----------
    name : str
        Short name, e.g. ``dance``.
    structure : (F, 3, P) array
        Points over time, in the source's units and axes.
    edges : (E, 2) int array
        Pairs of points joined by a bone or neighbours on a surface; for drawing and spatial terms.
    vertical : {"y", "z"}
        The axis of ``structure`` that points up.
    cameras : (F, 2, 3) array or None
        The body's own cameras, where its source has them.
    digest : str
        SHA-256 of the file behind the body, or the generator and its settings.
    stand_in : bool
        Whether generated data takes the place of a real sequence.
    gaps : bool
        Whether points may be NaN where they were not captured.

    Raises
    ------
    DatasetError
        If the structure is not an (F, 3, P) array of numbers, or an edge names a point that is not there.
    """

    name: str
    structure: Array
    edges: NDArray[np.int64] = field(default_factory=no_edges)
    vertical: str = "z"
    cameras: Array | None = None
    digest: str = ""
    stand_in: bool = False
    gaps: bool = False

    def __post_init__(self) -> None:
        S = self.structure
        if S.ndim != 3 or S.shape[1] != 3 or 0 in S.shape:
            raise DatasetError(f"body {self.name}: structure has shape {S.shape}, wanted (frames, 3, points)")
        if np.isinf(S).any() or (np.isnan(S).any() and not self.gaps):
            raise DatasetError(f"body {self.name}: structure holds NaN or infinite values; drop those points")
        if self.edges.size and (self.edges.min() < 0 or self.edges.max() >= S.shape[2]):
            raise DatasetError(f"body {self.name}: edges name points outside 0..{S.shape[2] - 1}")
        if self.cameras is not None and self.cameras.shape != (S.shape[0], 2, 3):
            raise DatasetError(f"body {self.name}: cameras have shape {self.cameras.shape}, wanted ({len(S)}, 2, 3)")

    @property
    def n_frames(self) -> int:
        return len(self.structure)

    @property
    def n_points(self) -> int:
        return int(self.structure.shape[2])


def observed(positions: Array) -> NDArray[np.bool_]:
    """Which of (F, k, P) positions are finite, (F, P)."""
    return np.asarray(np.isfinite(positions).all(axis=1))


def centre(structure: Array) -> Array:
    """An (F, k, P) array less each frame's centroid; points that are NaN do not count."""
    return np.subtract(structure, np.nanmean(structure, axis=2, keepdims=True))


def spread(structure: Array) -> float:
    """Mean over frames and axes of the standard deviation over points: the unit of length of scenes.

    Points that are NaN do not count.
    """
    return float(np.nanstd(structure, axis=2).mean())


def upright(structure: Array, vertical: str) -> Array:
    """An (F, 3, P) structure turned so that z points up; ``vertical`` is the axis that does so now."""
    if vertical == "z":
        return structure
    if vertical == "y":
        return structure[:, [2, 0, 1]]
    raise DatasetError(f"vertical axis is {vertical!r}, wanted 'y' or 'z'")
