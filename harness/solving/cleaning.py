"""What was taken out of a solution's tracks, in words and as rows of a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from nrsfm.datasets.scene import Scene
from nrsfm.harness.solving import folder
from nrsfm.methods.base import Cleaned, Reconstruction


def told(cleaned: Cleaned) -> Iterator[tuple[str, str]]:
    """Name and text of the summary's lines on outliers and scale."""
    if (outliers := cleaned.outliers) is not None:
        n, tracks = int(outliers.sum()), int(outliers.any(axis=0).sum())
        places = f"{n} of the observations ({outliers.mean():.2%}), on {tracks} of the tracks"
        yield "outliers", f"{places}; taken for missing, listed in {folder.OUTLIERS}" if n else "none"
    if (scales := cleaned.scales) is not None:
        words = f"from {scales.min():.3g} to {scales.max():.3g}, taken out; structure is in units of the tracks at 1"
        yield "image scale", words if np.ptp(scales) else "no change that deformation does not explain"


def outlier_rows(
    scene: Scene, found: Reconstruction, frames: Sequence[str], ids: Sequence[str]
) -> list[dict[str, Any]]:
    """Frame, track and residual of each outlier: its distance from R S, in units of the tracks at scale 1."""
    cleaned = found.cleaned
    if cleaned is None or cleaned.outliers is None:
        return []
    residuals = np.full(cleaned.outliers.shape, np.nan)
    if found.structure is not None and found.cameras is not None:
        images = found.cameras @ found.structure
        shift = np.nanmean(cleaned.tracks - images, axis=2, keepdims=True)
        scales = 1.0 if cleaned.scales is None else cleaned.scales[:, None, None]
        residuals = np.linalg.norm(scene.tracks / scales - images - shift, axis=1)
    places = np.argwhere(cleaned.outliers).tolist()
    known = [(f, p, float(residuals[f, p]) if residuals[f, p] >= 0 else None) for f, p in places]
    return [{"frame": frames[f], "track": ids[p], "residual": r} for f, p, r in known]
