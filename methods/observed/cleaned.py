"""Tracks as a method gets them, and what was taken out of them before: outliers, and the scale of each frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nrsfm.methods.base import Array, Mask
from nrsfm.methods.gaps import complete
from nrsfm.methods.observed.outliers import find_outliers
from nrsfm.methods.observed.scale import estimate_scales


@dataclass(frozen=True, eq=False)
class Cleaned:
    """Cleaned tracks. What was not looked for is None.

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

    @cached_property
    def whole(self) -> Array:
        """(F, 2, P) tracks, completed where they are not visible; see :func:`nrsfm.methods.gaps.complete`."""
        return complete(self.tracks, self.visible)

    def without_outliers(self) -> Cleaned:
        """With outliers marked as not visible."""
        outliers = find_outliers(self.tracks, self.visible)
        if not outliers.any():
            return replace(self, outliers=outliers)
        visible = ~outliers if self.visible is None else self.visible & ~outliers
        tracks = np.where(visible[:, None], self.tracks, np.nan)
        return replace(self, tracks=tracks, visible=visible, outliers=outliers)

    def at_one_scale(self, cameras: Array) -> Cleaned:
        """With the scales taken out of the tracks, where the change of scale is significant; cameras (F, 2, 3)."""
        found = estimate_scales(self.whole, cameras)
        scales = found.scales if found.significant else np.ones_like(found.scales)
        tracks = self.tracks / scales[:, None, None]
        return replace(self, tracks=tracks, scales=scales, scale_gain=found.gain)
