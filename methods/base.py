"""What every method takes and gives: arrays in, Reconstruction out."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

Array = NDArray[np.float64]


Labels = NDArray[np.int64]


Mask = NDArray[np.bool_]


#: Called during long work with (iteration, iterations, residuals by name); see :func:`stage`, too.
Progress = Callable[[int, int, Mapping[str, float]], None]


#: Ways to keep diag(C) = 0, see :class:`nrsfm.methods.multibody.printed.MultiBody`.
DIAGONALS = ("threshold", "exact", "paper")


#: Takes the place of cameras where a method uses none.
NO_CAMERAS: Array = np.empty((0, 2, 3))


class MethodError(ValueError):
    """Input or settings that a method cannot work with. The message is one line with the remedy."""


@dataclass(frozen=True)
class Reconstruction:
    """What a method found. Absent parts are None: a method never fills in what it does not compute.

    Parameters
    ----------
    labels : (P,) int array or None
        Body index of each track.
    structure : (F, 3, P) array or None
        Points over time in the units of the tracks, centred per frame.
    cameras : (F, 2, 3) array or None
        The cameras that the structure was made with.
    affinity : (P, P) array, sparse array or None
        What was clustered.
    history : mapping of str to (T,) array
        Curves by iteration: ``objective``, residuals, and what the iteration took: ``seconds`` of all cores and
        ``operations``.
    """

    labels: Labels | None = None
    structure: Array | None = None
    cameras: Array | None = None
    affinity: Array | sp.sparray | None = None
    history: Mapping[str, Array] = field(default_factory=dict)


class Method(BaseEstimator):
    """A method: hyper-parameters in the constructor, work in :meth:`reconstruct`.

    ``get_params`` and ``set_params`` are scikit-learn's. ``provides`` names the parts of the Reconstruction
    that the method computes, of ``labels`` and ``structure``. ``version`` is raised whenever results change, so
    that finished trials of the version before are not taken for those of this one. A method whose ``uses_cameras``
    is false runs on scenes without cameras, and none are estimated for it.
    """

    provides: ClassVar[frozenset[str]] = frozenset()
    uses_cameras: ClassVar[bool] = True
    version: ClassVar[str] = "1"

    @abstractmethod
    def reconstruct(
        self,
        tracks: Array,
        cameras: Array,
        n_bodies: int | None,
        *,
        visible: Mask | None = None,
        edges: NDArray[np.int64] | None = None,
        progress: Progress | None = None,
    ) -> Reconstruction:
        """Reconstruct and segment.

        Parameters
        ----------
        tracks : (F, 2, P) array
            Image coordinates, finite where they are visible.
        cameras : (F, 2, 3) array
            Orthographic cameras with orthonormal rows, known or estimated; :data:`NO_CAMERAS` for a method
            that uses none.
        n_bodies : int or None
            Number of clusters, at least 1; None when it is to be estimated.
        visible : (F, P) bool array, optional
            False where a track is not observed, and its position is NaN; all are by default.
        edges : (E, 2) int array, optional
            Neighbouring tracks, for methods with a spatial term.
        progress : callable, optional
            Told of every iteration of long work.

        Raises
        ------
        MethodError
            If shapes do not fit or the method cannot do what is asked.
        """

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float | None:
        """Bytes that :meth:`reconstruct` is going to take at its peak, foreseen from the sizes; None if not known."""
        return None


def stage(progress: Progress | None, name: str) -> None:
    """Tell whoever follows what is being done now: ``structure``, ``clustering``.

    A progress that has a method ``stage`` is told; a plain function hears of iterations alone.
    """
    tell = getattr(progress, "stage", None)
    if tell is not None:
        tell(name)


def no_edges() -> NDArray[np.int64]:
    return np.zeros((0, 2), dtype=np.int64)


@dataclass(frozen=True)
class Standardised:
    """Tracks centred per frame and scaled to unit mean per-row standard deviation."""

    W: Array
    scale: float


def standardise(tracks: Array, visible: Mask | None = None) -> Standardised:
    """Centre (F, 2, P) tracks per frame and scale them to unit mean per-row standard deviation.

    Centred tracks obey W = R S without a translation (Kumar, Dai, Li, 3DV 2016, eq. 1). The weights of the methods
    assume these units. Where ``visible`` (F, P) is False nothing counts, and W is 0.

    Raises
    ------
    MethodError
        If the tracks are not an (F, 2, P) array, finite where they are visible, or all coincide; or as
        :func:`check_gaps`.
    """
    if visible is None:
        check_tracks(tracks)
        W = tracks - tracks.mean(axis=2, keepdims=True)
        scale = float(W.std(axis=2).mean())
    else:
        check_gaps(tracks, visible)
        seen = np.where(visible[:, None], tracks, np.nan)
        W = np.nan_to_num(seen - np.nanmean(seen, axis=2, keepdims=True))
        scale = float(np.nanstd(seen, axis=2).mean())
    if scale == 0:
        raise MethodError("all tracks coincide in every frame; there is nothing to reconstruct")
    return Standardised(W / scale, scale)


def check_setting(owner: object, name: str, low: float, *, strict: bool = True, whole: bool = False) -> None:
    """Raise MethodError unless a hyper-parameter is a finite number above ``low`` (or at least it, if not strict)."""
    value = getattr(owner, name)
    kind = int if whole else int | float
    fits = isinstance(value, kind) and not isinstance(value, bool) and abs(value) < float("inf")
    if not fits or value < low or (strict and value == low):
        wanted = f"a {'whole ' if whole else ''}number {'>' if strict else '>='} {low:g}"
        raise MethodError(f"{type(owner).__name__}: {name} is {value!r}, wanted {wanted}")


def check_word(owner: object, name: str, words: Sequence[str]) -> None:
    """Raise MethodError unless a hyper-parameter is one of some words."""
    if getattr(owner, name) not in words:
        raise MethodError(f"method.{name} is {getattr(owner, name)!r}, wanted one of {', '.join(words)}")


def check_tracks(tracks: Array) -> None:
    """Raise MethodError unless the tracks are a finite (F, 2, P) array."""
    check_shape(tracks)
    if not np.isfinite(tracks).all():
        raise MethodError("tracks hold NaN or infinite values; remove those tracks or frames, or say what is visible")


def check_shape(tracks: Array) -> None:
    """Raise MethodError unless the tracks are an (F, 2, P) array of some frames and points."""
    if tracks.ndim != 3 or tracks.shape[1] != 2 or 0 in tracks.shape:
        raise MethodError(f"tracks have shape {tracks.shape}, wanted (frames, 2, points)")


def check_gaps(tracks: Array, visible: Mask) -> None:
    """Raise MethodError unless the mask fits (F, 2, P) tracks, which are finite where it says so, and sees enough.

    Every frame must show two points and every track two frames.
    """
    if tracks.ndim != 3 or tracks.shape[1] != 2 or visible.shape != (tracks.shape[0], tracks.shape[2]):
        raise MethodError(f"tracks have shape {tracks.shape} and visible {visible.shape}, wanted (F, 2, P) and (F, P)")
    if not np.isfinite(tracks.transpose(0, 2, 1)[visible]).all():
        raise MethodError("visible tracks hold NaN or infinite values; mark them as not visible")
    for axis, word in ((1, "frame"), (0, "track")):
        few = np.flatnonzero(visible.sum(axis=axis) < 2)
        if len(few):
            raise MethodError(f"{word} {few[0]} is observed less than twice; leave it out")


def check_cameras(cameras: Array, n_frames: int) -> None:
    """Raise MethodError unless the cameras are (F, 2, 3) with orthonormal rows, R_f R_f' = I."""
    if cameras.shape != (n_frames, 2, 3):
        raise MethodError(f"cameras have shape {cameras.shape}, wanted {(n_frames, 2, 3)}")
    if not np.allclose(cameras @ cameras.transpose(0, 2, 1), np.eye(2), atol=1e-6):
        raise MethodError("camera rows are not orthonormal")


def check_bodies(n_bodies: int | None, n_points: int, least: int = 2) -> None:
    """Raise MethodError unless tracks can be told apart into that many bodies, None for an unknown number."""
    if n_bodies is not None and not least <= n_bodies <= n_points:
        raise MethodError(
            f"asked to tell {n_points} tracks apart into {n_bodies} bodies; segmentation needs {least} to {n_points} "
            "bodies"
        )
