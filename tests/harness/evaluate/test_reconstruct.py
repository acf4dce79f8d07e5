"""What a method gives is checked before it counts as a result."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.reconstruct import WIDEST, reconstruct
from nrsfm.methods.base import Method, MethodError, Observations, Reconstruction

KNOWN = {"source": "known"}


@dataclass(kw_only=True, eq=False, repr=False)
class Stretched(Method):
    """Points on their lines of sight, one of them far out."""

    provides = frozenset({"structure"})

    reach: float = 1.0

    def reconstruct(self, observations: Observations, n_bodies: int | None) -> Reconstruction:
        R = observations.required_cameras()
        S = R.transpose(0, 2, 1) @ observations.tracks
        S[:, :, 3] += self.reach * np.cross(R[:, 0], R[:, 1])
        return Reconstruction(structure=S, cameras=R)


def test_structure_far_wider_than_the_tracks_is_no_result(small_scene: Scene) -> None:
    width = float(np.abs(small_scene.tracks).max())
    assert reconstruct(small_scene, Stretched(reach=width), 2, KNOWN).structure is not None
    with pytest.raises(MethodError, match=r"times as wide as the tracks, track 3 most of all") as raised:
        reconstruct(small_scene, Stretched(reach=3 * WIDEST * width), 2, KNOWN)
    assert "\n" not in str(raised.value)


def test_units_and_origin_of_the_tracks_do_not_matter(small_scene: Scene) -> None:
    """The same structure in pixels, far from the origin of the image."""
    width = float(np.abs(small_scene.tracks).max())
    pixels = replace(small_scene, tracks=100 * small_scene.tracks + 1e4, structure=None)
    assert reconstruct(pixels, Stretched(reach=100 * width), 2, KNOWN).structure is not None
    with pytest.raises(MethodError, match="wide as the tracks"):
        reconstruct(pixels, Stretched(reach=300 * WIDEST * width), 2, KNOWN)
