"""Forecast of a trial's peak memory, and the refusal of trials that do not fit."""

from __future__ import annotations

from typing import NamedTuple

from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import Method, MethodError

BASE_GB = 0.3  # of a trial's process before it solves anything: interpreter, libraries, the scene


class Size(NamedTuple):
    """The sizes of a scene that a method's memory depends on."""

    n_frames: int
    n_points: int
    n_edges: int

    @classmethod
    def of(cls, scene: Scene) -> Size:
        return cls(scene.n_frames, scene.n_points, len(scene.edges))


def foreseen_gb(method: Method, size: Size) -> float | None:
    """Peak memory of a trial in GB (2^30 bytes); None where the method has no forecast.

    Raises MethodError if the method's own forecast fails.
    """
    try:
        need = method.memory(*size)
    except Exception as error:
        raise MethodError(f"{type(method).__name__}.memory ended with {type(error).__name__}: {error}") from error
    return None if need is None else BASE_GB + need / 2**30


def refusal(method: Method, size: Size, memory_gb: float) -> str:
    """Message why a trial does not fit, with the remedy; "" when it fits or there is no forecast."""
    need = foreseen_gb(method, size)
    if need is None or need <= memory_gb:
        return ""
    return (
        f"{size.n_points} tracks over {size.n_frames} frames need about {need:.1f} GB and limits.memory_gb is "
        f"{memory_gb:g}; raise it, take fewer points (dataset.points), or a method for dense tracks (ours_c)"
    )
