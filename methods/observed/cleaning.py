"""What is taken out of tracks before cameras are estimated and a method runs: outliers, and the scale of each frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nrsfm.methods.base import Array, Cleaned
from nrsfm.methods.observed.outliers import find_outliers
from nrsfm.methods.observed.scale import estimate_scales


def without_outliers(cleaned: Cleaned) -> Cleaned:
    """With outliers marked as not visible."""
    outliers = find_outliers(cleaned.tracks, cleaned.visible)
    if not outliers.any():
        return replace(cleaned, outliers=outliers)
    visible = ~outliers if cleaned.visible is None else cleaned.visible & ~outliers
    tracks = np.where(visible[:, None], cleaned.tracks, np.nan)
    return replace(cleaned, tracks=tracks, visible=visible, outliers=outliers)


def at_one_scale(cleaned: Cleaned, whole: Array, cameras: Array) -> Cleaned:
    """With the scales of frames taken out of the tracks, where their change is significant.

    They are estimated from ``whole``, the completed tracks (F, 2, P), and cameras (F, 2, 3).
    """
    found = estimate_scales(whole, cameras)
    scales = found.scales if found.significant else np.ones_like(found.scales)
    return replace(cleaned, tracks=cleaned.tracks / scales[:, None, None], scales=scales, scale_gain=found.gain)
