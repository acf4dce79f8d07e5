"""Directions of image motion from smooth to rough, and the noise of the tracks.

The bodies' mean shapes and slow motions lie in one common low-dimensional space and have nearly all the energy, so that
tracks express each other across bodies as long as those dominate. The differences between bodies are spread over many
faint directions. Weights that flatten the spectrum amplify them, as far as noise allows.

Trajectory basis: Akhter, Sheikh, Khan, Kanade, "Trajectory space", PAMI 2011.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.ndimage

from nrsfm.methods.base import Array, MethodError
from nrsfm.methods.structure.pta import trajectory_basis


def directions(cameras: Array) -> Array:
    """Orthonormal directions of the image tracks of moving 3D points, from smooth to rough.

    A random trajectory whose DCT coefficient k has variance 1/k^2 in each coordinate has a random (2F,) image track.
    The directions are the principal ones of such tracks after the images of points at rest are projected out. They
    depend on the (F, 2, 3) cameras alone, and are orthogonal to every point at rest. O(F^3).

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
    theta = trajectory_basis(F, F)[:, 1:] / np.arange(1, F)
    images = np.einsum("fij,fk->fikj", cameras, theta).reshape(2 * F, 3 * (F - 1))
    images -= at_rest @ (at_rest.T @ images)
    Q: Array = scipy.linalg.eigh(images @ images.T, check_finite=False)[1]
    return Q[:, : at_rest.shape[1] - 1 : -1]


def noise_variance(motion: Array) -> float:
    """Variance of white image noise, from (r, P) motion along :func:`directions`.

    The roughest quarter of the directions holds next to no motion. The estimate is the lower quartile over the tracks
    of their mean square there, so that one body that does move fast is not taken for noise.
    """
    rough = motion[3 * len(motion) // 4 :]
    return float(np.quantile((rough**2).mean(axis=0), 0.25))


def spectrum(motion: Array) -> Array:
    """Mean square of each of the r directions over the tracks, (r,), smoothed over three neighbours to either side."""
    energy = (motion**2).mean(axis=1)
    least = max(1e-12 * float(energy.max()), np.finfo(float).tiny)
    smoothed: Array = np.exp(scipy.ndimage.gaussian_filter1d(np.log(energy + least), 3.0))
    return smoothed
