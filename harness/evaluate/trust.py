"""How far a structure can be trusted: an error expected without the truth, and a verdict with its reasons.

The expected error is that of :func:`nrsfm.harness.evaluate.metrics.e_3d_dai`. Three errors add up as squares. x is the
mean deviation of :func:`nrsfm.methods.structure.uncertainty.deviations` over the spread of the images, g the turn of a
full circle over that of the cameras:

    depth    DEPTH (x g)^POWER      what images do not determine
    cameras  CAMERAS r g^2          of estimated ones; r how far they are from the images' factorisation
    images   IMAGES q               what of the tracks the structure leaves, q its rms over their spread

and the sum levels off at UNKNOWN, the error where images say nothing of depth. docs/trust.md says how they were fitted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from nrsfm.datasets.body import centre
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.reprojection import given, image_residuals, rms
from nrsfm.methods.base import Array, Reconstruction
from nrsfm.methods.numerics.linear import axes
from nrsfm.methods.structure.rotation import orthonormality
from nrsfm.methods.structure.uncertainty import deviations

DEPTH, POWER, CAMERAS, IMAGES, UNKNOWN = 2.6, 1.43, 30.0, 0.27, 1.35

#: The expected error below which a structure is good, and that from which it is not determined.
GOOD, UNDETERMINED = 0.2, 0.5
#: Degrees of :func:`camera_turn` below which the camera is said to hardly turn, and those of a full circle.
SMALL_TURN, CIRCLE = 30.0, float(np.rad2deg(np.sqrt(12) * np.pi / 4))
#: Spread of depth over that of an image axis outside of which the structure is said to be flat or deep.
FLAT, DEEP = 0.3, 3.0

#: Share of outliers from which they are mentioned.
MANY = 0.01

VERDICTS = ("good", "doubtful", "not determined")


@dataclass(frozen=True)
class Trust:
    """An expected error and where it comes from.

    Parameters
    ----------
    expected : float
        Expected e_3d_dai.
    depth, cameras, images : float
        Its parts before they level off.
    turn : float
        See :func:`camera_turn`.
    depth_ratio : float
        Spread of depth over that of an image axis.
    tracks : (P,) array
        Expected error of each track, a distance in the units of the tracks.
    worst : str
        Name of the track of the largest one.
    estimated : bool
        Whether the cameras were estimated.
    outliers : float
        Share of the observations that were taken for missing as they fit no motion.
    zoom : float
        Largest over smallest image scale that was taken out, 1 for none.
    """

    expected: float
    depth: float
    cameras: float
    images: float
    turn: float
    depth_ratio: float
    tracks: Array
    worst: str
    estimated: bool
    outliers: float = 0.0
    zoom: float = 1.0

    @property
    def verdict(self) -> str:
        """One of :data:`VERDICTS`."""
        return VERDICTS[int(self.expected >= GOOD) + int(self.expected >= UNDETERMINED)]

    @property
    def reasons(self) -> tuple[str, ...]:
        """Plain sentences, the verdict's main reason first."""
        return tuple(self._reasons())

    @property
    def figures(self) -> dict[str, float]:
        """Figures by the names of their metrics."""
        return {
            "expected_e_3d": self.expected,
            "expected_depth": self.depth,
            "expected_cameras": self.cameras,
            "expected_images": self.images,
            "camera_turn": self.turn,
            "depth_ratio": self.depth_ratio,
        }

    @property
    def record(self) -> dict[str, Any]:
        """Verdict, reasons, figures and tracks as plain data."""
        rounded = [float(f"{error:.4g}") for error in self.tracks]
        cleaned = {"outliers": self.outliers, "zoom": self.zoom}
        return {"verdict": self.verdict, "reasons": self.reasons, **self.figures, **cleaned, "tracks": rounded}

    def _reasons(self) -> Iterator[str]:
        yield f"expect an error of {self.expected:.2g} of the scene's spread"
        turns = self.turn >= SMALL_TURN
        if turns:
            yield f"lines of sight span {self.turn:.0f} degrees"
        else:
            yield f"the camera hardly turns ({self.turn:.0f} degrees), so images tell no depth; film from more sides"
        parts = {"depth": self.depth, "cameras": self.cameras, "images": self.images}
        main = max(parts, key=lambda name: parts[name])
        if self.expected >= GOOD and (turns or main != "depth"):
            yield {
                "depth": "points move too fast for a camera that turns so slowly, so their depth is open",
                "cameras": "the cameras estimated from the tracks contradict each other",
                "images": "many observations fit no moving points: look for outliers, another layout or another scale",
            }[main]
        if self.outliers > MANY:
            yield f"{self.outliers:.1%} of the observations fit no motion and were left out"
        if self.zoom > 1:
            yield f"the image scale changes {self.zoom:.2g}-fold, which was taken out"
        if not FLAT < self.depth_ratio < DEEP:
            yield f"the structure is {self.depth_ratio:.2g} times as deep as it is wide"
        if self.expected < UNDETERMINED and float(self.tracks.max()) > 3 * float(np.median(self.tracks)):
            yield f"track {self.worst} is determined worst, to about {self.tracks.max():.2g} in the tracks' units"
        if self.estimated:
            yield "cameras are from the tracks: depth may be mirrored"

    def __str__(self) -> str:
        return f"{self.verdict}: {'; '.join(self.reasons)}"


def trust(scene: Scene, found: Reconstruction, *, known_cameras: bool) -> Trust | None:
    """Trust in a reconstruction of a scene's tracks; None if it has no structure or no cameras.

    Costs O(F^3 + F P log F), an SVD of the tracks where cameras were estimated, and the cubes of the tracks' gaps.
    """
    if found.structure is None or found.cameras is None:
        return None
    images = given(scene, found)
    R, S = found.cameras, centre(found.structure)
    spread = float(np.nanstd(images.tracks, axis=2).mean())
    deviation = deviations(S, R, images.visible).mean(axis=0)
    turn = camera_turn(R)
    lack = CIRCLE / max(turn, 1e-3)
    depth = DEPTH * (float(deviation.mean()) / spread * lack) ** POWER
    cameras = 0.0 if known_cameras else CAMERAS * orthonormality(R @ S, R) * lack**2
    misfit = IMAGES * rms(image_residuals(images.tracks, R, S)) / spread
    total = float(np.sqrt(depth**2 + cameras**2 + misfit**2))
    expected = total / float(np.hypot(1, total / UNKNOWN))
    depths = np.einsum("fi,fip->fp", axes(R)[:, 2], S)
    tracks = expected * spread * deviation / max(float(deviation.mean()), np.finfo(float).tiny)
    worst = int(tracks.argmax())
    return Trust(
        expected=expected,
        depth=depth,
        cameras=cameras,
        images=misfit,
        turn=turn,
        depth_ratio=float(depths.std(axis=1).mean()) / spread,
        tracks=tracks,
        worst=scene.track_ids[worst] if scene.track_ids else str(worst),
        estimated=not known_cameras,
        outliers=0.0 if images.outliers is None else float(images.outliers.mean()),
        zoom=1.0 if images.scales is None else float(images.scales.max() / images.scales.min()),
    )


def camera_turn(cameras: Array) -> float:
    """Degrees over which the viewing directions of (F, 2, 3) cameras are spread, 156 at most in one plane.

    Directions that are even over a short arc of a plane have the arc's length; lines count, not their senses.
    """
    N = axes(cameras)[:, 2]
    aside = 1 - float(np.linalg.eigvalsh(N.T @ N / len(N))[-1])
    return float(np.rad2deg(np.sqrt(12) * np.arcsin(np.sqrt(np.clip(aside, 0, 1)))))
