"""What every method takes and gives: Observations in, Reconstruction out."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

Array = NDArray[np.float64]
Labels = NDArray[np.int64]
Mask = NDArray[np.bool_]
#: Called during long work with (iteration, iterations, residuals by name); see :func:`stage`, too.
Progress = Callable[[int, int, Mapping[str, float]], None]


class MethodError(ValueError):
    """Input or settings that a method cannot work with. The message is one line with the remedy."""


@dataclass(frozen=True, eq=False)
class Observations:
    """The input of a method: image tracks of one scene and what is known about them.

    Parameters
    ----------
    tracks : (F, 2, P) array
        Image coordinates, finite where they are visible.
    cameras : (F, 2, 3) array or None
        Orthographic cameras with orthonormal rows, R_f R_f' = I, known or estimated.
    visible : (F, P) bool array or None
        False where a track is not observed; its position there may be NaN. None means that all are observed.
    edges : (E, 2) int array or None
        Pairs of neighbouring tracks, for methods with a spatial term.
    progress : callable or None
        Called after every iteration of long work.

    Raises
    ------
    MethodError
        If a shape does not fit, a visible position is not finite, a camera's rows are not orthonormal, or a frame or
        track is observed less than twice.
    """

    tracks: Array
    cameras: Array | None = None
    visible: Mask | None = None
    edges: NDArray[np.int64] | None = None
    progress: Progress | None = None

    def __post_init__(self) -> None:
        check_tracks(self.tracks, self.visible)
        if self.cameras is not None:
            check_cameras(self.cameras, len(self.tracks))

    def required_cameras(self) -> Array:
        """The cameras, for a method that cannot do without; MethodError if there are none."""
        if self.cameras is None:
            raise MethodError("the method needs cameras and there are none; estimate them from the tracks")
        return self.cameras

    def stage(self, name: str) -> None:
        """Report the start of a stage of the work, such as ``clustering``."""
        stage(self.progress, name)


@dataclass(frozen=True, eq=False)
class Cleaned:
    """Tracks as a method gets them, and what was taken out of them before. What was not looked for is None.

    Parameters
    ----------
    tracks : (F, 2, P) array
        Image coordinates divided by the scales; NaN where not visible.
    visible : (F, P) bool array or None
        False where a track is not observed or was an outlier; None if all count.
    outliers : (F, P) bool array or None
        Observations that do not fit the motion around them.
    scales : (F,) array or None
        Scale of each frame, of geometric mean 1; all 1 where the tracks show no change of scale.
    scale_gain : float or None
        Evidence for a change of scale, see :func:`nrsfm.methods.observed.scale.estimate_scales`.
    """

    tracks: Array
    visible: Mask | None = None
    outliers: Mask | None = None
    scales: Array | None = None
    scale_gain: float | None = None


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """The result of a method. Absent parts are None: a method never fills in what it does not compute.

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
        Curves by iteration: ``objective``, residuals, ``seconds`` of CPU time and ``operations``.
    cleaned : Cleaned or None
        The tracks that the method was given, where outliers or scales were looked for; set by the harness.
    """

    labels: Labels | None = None
    structure: Array | None = None
    cameras: Array | None = None
    affinity: Array | sp.sparray | None = None
    history: Mapping[str, Array] = field(default_factory=dict)
    cleaned: Cleaned | None = None


class Method(BaseEstimator):  # type: ignore[misc]
    """Base class of all methods: hyper-parameters in the constructor, the work in :meth:`reconstruct`.

    ``get_params`` and ``set_params`` are scikit-learn's. ``@dataclass(eq=False, repr=False)`` writes a constructor that
    stores its arguments and does nothing else, as scikit-learn demands.

    Attributes
    ----------
    provides : frozenset of str
        The parts of the Reconstruction that the method computes: ``labels``, ``structure`` or both.
    uses_cameras : bool
        False for a method that runs on scenes without cameras; none are estimated for it.
    handles_gaps : bool
        True for a method that reads ``visible``. Others are never given tracks with gaps.
    version : str
        To be raised whenever results change, so that finished trials are run again.
    """

    provides: ClassVar[frozenset[str]] = frozenset()
    uses_cameras: ClassVar[bool] = True
    handles_gaps: ClassVar[bool] = False
    version: ClassVar[str] = "1"

    @abstractmethod
    def reconstruct(self, observations: Observations, n_bodies: int | None) -> Reconstruction:
        """Reconstruct and segment.

        Parameters
        ----------
        observations : Observations
            Checked already; arrays are not to be written to.
        n_bodies : int or None
            Number of clusters, at least 1; None when it is to be estimated.

        Raises
        ------
        MethodError
            If a setting is wrong, or the method cannot work with the number of bodies.
        """

    def memory(self, n_frames: int, n_points: int, n_edges: int = 0) -> float | None:
        """Peak memory of :meth:`reconstruct` in bytes, forecast from the sizes; None if not known."""
        return None


def check_gap_handling(method: Method, visible: Mask | None) -> None:
    """Raise MethodError if tracks have gaps and the method does not declare that it handles them."""
    if visible is not None and not method.handles_gaps:
        raise MethodError(
            f"{type(method).__name__} cannot work with gaps in the tracks (handles_gaps is False); take another method"
        )


def stage(progress: Progress | None, name: str) -> None:
    """Report the start of a stage, such as ``clustering``, if ``progress`` has a method ``stage``."""
    report = getattr(progress, "stage", None)
    if report is not None:
        report(name)


@dataclass(frozen=True, eq=False)
class Standardised:
    """Tracks centred per frame and scaled to unit mean per-row standard deviation."""

    W: Array
    scale: float


def standardise(tracks: Array, visible: Mask | None = None) -> Standardised:
    """Centre (F, 2, P) tracks per frame and scale them to unit mean per-row standard deviation.

    Centred tracks obey W = R S without a translation (Kumar, Dai, Li, 3DV 2016, eq. 1). The weights of the methods
    assume these units. Positions that are not visible do not count, and W is 0 there.

    Raises
    ------
    MethodError
        As :func:`check_tracks`, or if all tracks coincide.
    """
    check_tracks(tracks, visible)
    if visible is None:
        W = tracks - tracks.mean(axis=2, keepdims=True)
        scale = float(W.std(axis=2).mean())
    else:
        seen = np.where(visible[:, None], tracks, np.nan)
        W = np.nan_to_num(seen - np.nanmean(seen, axis=2, keepdims=True))
        scale = float(np.nanstd(seen, axis=2).mean())
    if scale == 0:
        raise MethodError("all tracks coincide in every frame; there is nothing to reconstruct")
    return Standardised(W / scale, scale)


def check_positive(owner: object, *names: str) -> None:
    """Raise MethodError unless each of these hyper-parameters is a finite number above 0."""
    _check(owner, names, lambda value: _is_number(value) and value > 0, "a number > 0")


def check_at_least(owner: object, least: float, *names: str) -> None:
    """Raise MethodError unless each of these hyper-parameters is a finite number of at least ``least``."""
    _check(owner, names, lambda value: _is_number(value) and value >= least, f"a number >= {least:g}")


def check_count(owner: object, *names: str, least: int = 1) -> None:
    """Raise MethodError unless each of these hyper-parameters is a whole number of at least ``least``."""
    _check(
        owner,
        names,
        lambda value: _is_number(value) and isinstance(value, int) and value >= least,
        f"a whole number >= {least}",
    )


def check_word(owner: object, name: str, words: Sequence[str]) -> None:
    """Raise MethodError unless a hyper-parameter is one of some words."""
    _check(owner, [name], lambda value: value in words, f"one of {', '.join(words)}")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")


def _check(owner: object, names: Iterable[str], fits: Callable[[Any], bool], wanted: str) -> None:
    for name in names:
        value = getattr(owner, name)
        if not fits(value):
            raise MethodError(f"{type(owner).__name__}: {name} is {value!r}, wanted {wanted}")


def check_tracks(tracks: Array, visible: Mask | None = None) -> None:
    """Raise MethodError unless tracks are (F, 2, P) and finite where visible, and every frame and track is seen twice.

    ``visible`` is an (F, P) mask, or None where everything is observed.
    """
    if tracks.ndim != 3 or tracks.shape[1] != 2 or 0 in tracks.shape:
        raise MethodError(f"tracks have shape {tracks.shape}, wanted (frames, 2, points)")
    if visible is None:
        if not np.isfinite(tracks).all():
            raise MethodError(
                "tracks hold NaN or infinite values; remove those tracks or frames, or say what is visible"
            )
        return
    if visible.shape != (tracks.shape[0], tracks.shape[2]):
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
    """Raise MethodError unless the tracks can be split into that many bodies; None, for an unknown number, passes."""
    if n_bodies is not None and not least <= n_bodies <= n_points:
        raise MethodError(
            f"{n_points} tracks cannot be split into {n_bodies} bodies; segmentation needs {least} to {n_points} bodies"
        )
