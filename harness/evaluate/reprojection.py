"""What a reconstruction leaves of the tracks that the method was given."""

from __future__ import annotations

import numpy as np

from nrsfm.datasets.body import centre
from nrsfm.datasets.scene import Scene
from nrsfm.methods.base import Array, Cleaned, Reconstruction


def given(scene: Scene, found: Reconstruction) -> Cleaned:
    """The tracks that the method was given: the cleaned ones, where they were cleaned."""
    return found.cleaned or Cleaned(scene.tracks, scene.visible)


def image_residuals(tracks: Array, cameras: Array, structure: Array) -> Array:
    """W - R S - t 1', (F, 2, P), t the best translation of each frame; NaN where tracks are not visible."""
    return centre(centre(tracks) - cameras @ structure)


def rms(residuals: Array) -> float:
    """Root mean square length of (F, 2, P) residuals; those that are NaN do not count."""
    return float(np.sqrt(np.nanmean(np.sum(residuals**2, axis=1))))


def reprojection_rms(scene: Scene, found: Reconstruction) -> float:
    """Root mean square distance of the visible tracks from R S, in their units, each frame's translation removed.

    Where the tracks were cleaned, it is that of the cleaned ones, in units of the tracks at scale 1. NaN where the
    reconstruction has no structure or no cameras.
    """
    if found.structure is None or found.cameras is None:
        return float("nan")
    return rms(image_residuals(given(scene, found).tracks, found.cameras, found.structure))
