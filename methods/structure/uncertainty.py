"""How well a moving point's place is determined by the cameras that saw it: a Gaussian process before turning cameras.

Each coordinate of a trajectory is a stationary process, the cosine of frequency k with variance s_k. An orthographic
camera leaves the depth d_f along the viewing direction n_f unknown. With K = T' diag(s) T, T the orthonormal DCT, the
depths given the images have the precision

    H = K^-1 o (N N'),   N (F, 3) the viewing directions, o the product of entries

because the prior's energy of the part of the trajectory that images leave open, n_f d_f, is d'(K^-1 o N N')d. Cameras
at rest give H = K^-1: images say nothing. The faster they turn and the smoother points move, the larger H is.
"""

from __future__ import annotations

import numpy as np
import scipy.fft
import scipy.linalg
from scipy.ndimage import gaussian_filter1d

from nrsfm.methods.base import Array, Mask
from nrsfm.methods.numerics.linear import axes

#: Neighbours over which the spectrum is smoothed.
WIDTH = 2.0
#: The least variance of a frequency, in parts of the largest one of moving points.
LEAST = 1e-10


def deviations(structure: Array, cameras: Array, visible: Mask | None = None) -> Array:
    """Standard deviations (F, P) of the places of points, given the images that the cameras saw of them.

    The spectrum is that of the structure itself, common to all points but for a factor of each. Hidden points lack
    their image coordinates as well. In the units of the structure. One inverse of an F x F matrix for all tracks, and
    for each track with gaps one of the size of its gaps: O(F^3 + F P log F) and the cubes of the gaps.

    Parameters
    ----------
    structure : (F, 3, P) array
        Centred in each frame.
    cameras : (F, 2, 3) array
    visible : (F, P) bool array, optional
    """
    F = len(structure)
    power = np.mean(scipy.fft.dct(structure, axis=0, norm="ortho") ** 2, axis=1)
    images = cameras @ structure
    s = spectrum(power, float(np.mean(images**2)))
    strength = np.mean(power[1:] / s[1:, None], axis=0)
    T = scipy.fft.dct(np.eye(F), axis=0, norm="ortho")
    precision = T.T @ (T / s[:, None])
    N = axes(cameras)[:, 2]
    variance = np.diag(_inverse(precision * (N @ N.T)))[:, None] * strength
    if visible is not None:
        for p in np.flatnonzero(~visible.all(axis=0)):
            gap = np.flatnonzero(~visible[:, p])
            variance[gap, p] += 2 * strength[p] * np.diag(_inverse(precision[np.ix_(gap, gap)]))
    return np.asarray(np.sqrt(variance))


def spectrum(power: Array, place: float) -> Array:
    """Variances s (F,) of the frequencies from the (F, P) power of points; ``place`` is the variance of a place.

    Of the points' mean places only their spread is known: s_0 = F place.
    """
    energy = power.mean(axis=1)
    energy = energy + max(LEAST * float(energy[1:].max()), np.finfo(float).tiny)
    smoothed = np.exp(gaussian_filter1d(np.log(energy[1:]), WIDTH, mode="nearest"))
    return np.concatenate([[len(power) * place], smoothed])


def _inverse(A: Array) -> Array:
    """Inverse of a symmetric positive definite matrix that may be so only up to rounding."""
    w, V = scipy.linalg.eigh(A, check_finite=False)
    inverse: Array = (V / np.maximum(w, 1e-14 * w[-1])) @ V.T
    return inverse
