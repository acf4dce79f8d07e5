"""Memory is foreseen before it is taken."""

from __future__ import annotations

from datasets.scene import Scene
from methods.base import Method

BASE_GB = 0.3  # of a trial's process before it solves anything: interpreter, libraries, the scene


def foreseen_gb(method: Method, scene: Scene) -> float | None:
    """GB (2^30 bytes) that a trial of the method on the scene takes at its peak; None where the method cannot say."""
    need = method.memory(scene.n_frames, scene.n_points, len(scene.edges))
    return None if need is None else BASE_GB + need / 2**30


def refusal(method: Method, scene: Scene, memory_gb: float) -> str:
    """Why a trial does not fit, with the remedy; "" when it does or when nobody can say."""
    need = foreseen_gb(method, scene)
    if need is None or need <= memory_gb:
        return ""
    return (
        f"{scene.n_points} tracks over {scene.n_frames} frames need about {need:.1f} GB and limits.memory_gb is "
        f"{memory_gb:g}; raise it, or take fewer points (dataset.points)"
    )
