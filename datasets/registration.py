"""Rules that remove a body's own rotation, so that the scene's camera carries all of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from nrsfm.datasets.body import Array, centre


def procrustes(structure: Array, vertical: str = "z", rounds: int = 10) -> Array:
    """Remove every frame's rotation by generalised Procrustes analysis.

    Every frame is rotated onto a reference, without reflections. The reference is the first frame, and in each later
    round the mean of the rotated frames.

    Parameters
    ----------
    structure : (F, 3, P) array
        Points over time; centred per frame before it is rotated.
    vertical : {"y", "z"}
        The axis that points up, which plays no part.
    rounds : int
        How often the reference is renewed.

    Returns
    -------
    (F, 3, P) array
        Centred and rotated copy.

    References
    ----------
    Gower, "Generalized Procrustes analysis", Psychometrika 1975.
    """
    S = centre(structure)
    reference = S[0]
    for _ in range(rounds):
        U, _, Vt = np.linalg.svd(np.einsum("ip,fjp->fij", reference, S))
        flip = np.ones((len(S), 3))
        flip[:, 2] = np.sign(np.linalg.det(U @ Vt))
        rotated: Array = ((U * flip[:, None, :]) @ Vt) @ S
        reference = rotated.mean(axis=0)
    return rotated


def without_turn(structure: Array, vertical: str = "z") -> Array:
    """Remove a body's constant turn about its vertical; what else it does, sways and steps, stays.

    The heading of a frame is the angle about the vertical that brings the first frame nearest to it (least squares).
    The turn is the slope of the least-squares line through the headings over the frames.

    Parameters
    ----------
    structure : (F, 3, P) array
    vertical : {"y", "z"}
        The axis that points up.

    Returns
    -------
    (F, 3, P) array
        Centred copy, frame f turned back by f times the turn.
    """
    S = centre(structure)
    i, j = {"y": (2, 0), "z": (0, 1)}[vertical]
    across, along = S[:, j], S[:, i]
    turned = np.einsum("fp,p->f", across, S[0, i]) - np.einsum("fp,p->f", along, S[0, j])
    kept = np.einsum("fp,p->f", along, S[0, i]) + np.einsum("fp,p->f", across, S[0, j])
    frames = np.arange(len(S))
    turn = np.polyfit(frames, np.unwrap(np.arctan2(turned, kept)), 1)[0]
    cos, sin = np.cos(turn * frames)[:, None], np.sin(turn * frames)[:, None]
    back = S.copy()
    back[:, i], back[:, j] = cos * along + sin * across, cos * across - sin * along
    return back


def as_stored(structure: Array, vertical: str = "z") -> Array:
    """The (F, 3, P) structure itself."""
    return structure


REGISTRATIONS: Mapping[str, Callable[[Array, str], Array]] = MappingProxyType(
    {"procrustes": procrustes, "turn": without_turn, "stored": as_stored}
)
