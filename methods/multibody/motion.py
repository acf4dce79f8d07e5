"""The motion that image tracks show, from smooth to rough, and how much noise lies on it.

The bodies' mean shapes and slow motions lie in one common low-dimensional space and have nearly all the energy, so that
tracks express each other across bodies as long as those dominate. What tells bodies apart is spread over many faint
directions. Weights that flatten the spectrum bring them out, as far as noise allows.

Trajectory basis: Akhter, Sheikh, Khan, Kanade, "Trajectory space", PAMI 2011.
"""

from __future__ import annotations

import numpy as np
import scipy.ndimage

from nrsfm.methods.base import Array, MethodError


def directions(cameras: Array) -> Array:
    """Orthonormal directions of the image tracks of moving 3D points, from smooth to rough.

    A random trajectory whose DCT coefficient k has variance 1/k^2 in each coordinate is seen as a random (2F,) image
    track. The principal directions of those, after the images of points at rest are projected out, depend on the
    cameras alone; whatever the depth, a point at rest leaves no trace in them. O(F^3).

    Parameters
    ----------
    cameras : (F, 2, 3) array

    Returns
    -------
    (2F, r) array
        r = 2F - 3, or 2F - 2 before a fixed camera.

    Raises
    ------
    MethodError
        If there are fewer than four frames.
    """
    F = len(cameras)
    if F < 4:
        raise MethodError(f"there are {F} frames; telling motion from noise needs at least 4")
    at_rest = scipy.linalg.orth(cameras.reshape(2 * F, 3))
    theta = scipy.fft.idct(np.eye(F), axis=0, norm="ortho")[:, 1:] / np.arange(1, F)
    images = np.einsum("fij,fk->fikj", cameras, theta).reshape(2 * F, 3 * (F - 1))
    images -= at_rest @ (at_rest.T @ images)
    Q = scipy.linalg.eigh(images @ images.T, check_finite=False)[1]
    return Q[:, : at_rest.shape[1] - 1 : -1]


def noise_variance(motion: Array) -> float:
    """Variance of white image noise, from (r, P) motion along :func:`directions`.

    The roughest quarter of the directions holds next to no motion. Of its mean squares by track, which noise makes
    alike, the lower quartile is taken: a body that does move fast there is not taken for noise.
    """
    rough = motion[3 * len(motion) // 4 :]
    return float(np.quantile((rough**2).mean(axis=0), 0.25))


def spectrum(motion: Array) -> Array:
    """Mean square of each of the r directions over the tracks, (r,), smoothed over three neighbours to either side."""
    energy = (motion**2).mean(axis=1)
    least = max(1e-12 * float(energy.max()), np.finfo(float).tiny)
    return np.exp(scipy.ndimage.gaussian_filter1d(np.log(energy + least), 3.0))
