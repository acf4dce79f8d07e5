"""Scenes: 2D tracks before an orthographic camera, and the truth where it is known."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array, no_edges, observed
from nrsfm.datasets.corruption import corrupt
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.gaps import drop
from nrsfm.datasets.noise import add_noise


@dataclass(frozen=True)
class Scene:
    """Input of a trial: 2D tracks, and the true structure, cameras and labels where they are known.

    Parameters
    ----------
    name : str
        Short name, part of every seed.
    tracks : (F, 2, P) array
        Image coordinates.
    bodies : tuple of str
        Names of the bodies, in the order of the labels.
    labels : (P,) int array or None
        Index of each track's body.
    structure : (F, 3, P) array or None
        True 3D points, centred per frame; NaN where a point was not captured.
    cameras : (F, 2, 3) array or None
        Orthographic cameras with orthonormal rows.
    visible : (F, P) bool array or None
        False where a track is not observed and its position is NaN; None if all are observed.
    edges : (E, 2) int array
        Bones or surface neighbours.
    digest : str
        Hash of the data files (or of the generator's settings) behind the scene.
    stand_in : bool
        Whether generated bodies take the place of real sequences that were not found.
    track_ids, frame_ids : tuple of str
        Names of the source for its tracks and frames; empty if it has none.
    notes : tuple of str
        Changes to the source's numbers that a reader must know.

    Raises
    ------
    DatasetError
        On shapes that do not fit each other, non-finite observed tracks, or cameras that are not orthonormal.
    """

    name: str
    tracks: Array
    bodies: tuple[str, ...] = ()
    labels: NDArray[np.int64] | None = None
    structure: Array | None = None
    cameras: Array | None = None
    visible: NDArray[np.bool_] | None = None
    edges: NDArray[np.int64] = field(default_factory=no_edges)
    digest: str = ""
    stand_in: bool = False
    track_ids: tuple[str, ...] = ()
    frame_ids: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        W = self.tracks
        if W.ndim != 3 or W.shape[1] != 2 or W.shape[0] < 2 or W.shape[2] < 2:
            raise DatasetError(f"scene {self.name}: tracks have shape {W.shape}, wanted (frames >= 2, 2, points >= 2)")
        n_frames, _, n_points = W.shape
        wanted = {
            "structure": (n_frames, 3, n_points),
            "cameras": (n_frames, 2, 3),
            "labels": (n_points,),
            "visible": (n_frames, n_points),
        }
        for key, shape in wanted.items():
            value = getattr(self, key)
            if value is not None and value.shape != shape:
                raise DatasetError(f"scene {self.name}: {key} has shape {value.shape}, wanted {shape}")
        for key, count in (("track_ids", n_points), ("frame_ids", n_frames)):
            if getattr(self, key) and len(getattr(self, key)) != count:
                raise DatasetError(f"scene {self.name}: {key} holds {len(getattr(self, key))} names, wanted {count}")
        bad = ~observed(W)
        if self.structure is not None:
            bad |= ~observed(self.structure)
        if self.visible is not None:
            bad &= self.visible
            _check_gaps(self.name, W, self.visible)
        if bad.any():
            frame, point = np.argwhere(bad)[0]
            raise DatasetError(
                f"scene {self.name}: {int(bad.sum())} track positions are NaN or infinite (first: frame {frame}, "
                f"point {point}); remove those tracks or mark them as not visible"
            )
        if self.cameras is not None:
            off = np.abs(self.cameras @ self.cameras.transpose(0, 2, 1) - np.eye(2)).max()
            if not off < 1e-6:
                raise DatasetError(f"scene {self.name}: camera rows are not orthonormal (off by {off:.2g})")

    @property
    def n_frames(self) -> int:
        return len(self.tracks)

    @property
    def n_points(self) -> int:
        return int(self.tracks.shape[2])

    @property
    def n_bodies(self) -> int | None:
        """Number of bodies, None when there are no labels."""
        return None if self.labels is None else len(np.unique(self.labels))

    def with_noise(self, level: float, repeat: int = 0) -> Scene:
        """A copy with noise on the tracks (see :func:`nrsfm.datasets.noise.add_noise`)."""
        return replace(self, tracks=add_noise(self.tracks, level, repeat, self.name))

    def with_gaps(self, kind: str, share: float, length: int = 1, repeat: int = 0) -> Scene:
        """A copy without a share of the observations (see :func:`nrsfm.datasets.gaps.drop`); the truth stays whole."""
        visible = drop(self.tracks, kind, share, length, repeat, self.name)
        if visible.all():
            return self
        return replace(self, tracks=np.where(visible[:, None], self.tracks, np.nan), visible=visible)

    def with_corruption(self, repeat: int = 0, **amounts: Any) -> Scene:
        """A copy with corrupted tracks (see :func:`nrsfm.datasets.corruption.corrupt`); the truth stays as it is."""
        return replace(self, tracks=corrupt(self.tracks, self.name, repeat=repeat, **amounts))


def _check_gaps(name: str, W: Array, visible: NDArray[np.bool_]) -> None:
    """Raise DatasetError unless hidden positions are NaN and every frame and every track is seen somewhere."""
    if not np.isnan(W.transpose(0, 2, 1)[~visible]).all():
        raise DatasetError(f"scene {name}: a hidden track position holds a number, wanted NaN")
    for axis, word in ((1, "frame"), (0, "track")):
        unseen = np.flatnonzero(~visible.any(axis=axis))
        if len(unseen):
            raise DatasetError(f"scene {name}: {word} {unseen[0]} is never observed; leave it out")
