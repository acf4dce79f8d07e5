"""Deviations of depth: the conditional covariance of a Gaussian process, written out densely; and invariances."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.fft

from nrsfm.datasets.cameras import orbit
from nrsfm.datasets.scene import Scene
from nrsfm.methods.numerics.linear import axes
from nrsfm.methods.structure.uncertainty import deviations, spectrum
from tests.methods.parts import present

F = 24


def walks(n_points: int, seed: int = 0) -> np.ndarray:
    """Smooth trajectories (F, 3, P) about fixed places."""
    rng = np.random.default_rng(seed)
    theta = scipy.fft.idct(np.eye(F), axis=0, norm="ortho")
    scale = np.concatenate([[np.sqrt(F)], 1 / np.arange(1, F) ** 1.5])
    S: np.ndarray = np.einsum("fk,kip->fip", theta * scale, rng.standard_normal((F, 3, n_points)))
    return S


def dense(S: np.ndarray, R: np.ndarray, p: int, visible: np.ndarray) -> np.ndarray:
    """Conditional covariance of the point's 3F coordinates given its visible images."""
    power = (scipy.fft.dct(S, axis=0, norm="ortho") ** 2).mean(axis=1)
    s = spectrum(power, float(np.mean((R @ S) ** 2)))
    T = scipy.fft.dct(np.eye(F), axis=0, norm="ortho")
    strength = (power[1:, p] / s[1:]).mean()
    K = np.kron(strength * (T.T * s) @ T, np.eye(3))
    A = np.zeros((2 * F, 3 * F))
    for f in range(F):
        A[2 * f : 2 * f + 2, 3 * f : 3 * f + 3] = R[f]
    A = A[np.repeat(visible, 2)]
    C: np.ndarray = K - K @ A.T @ np.linalg.solve(A @ K @ A.T, A @ K)
    return C


def test_deviations_are_those_of_the_conditional_process() -> None:
    S, R = walks(7), orbit(F, 9.0)
    found = deviations(S, R)
    N = axes(R)[:, 2]
    for p in (0, 4):
        C = dense(S, R, p, np.ones(F, dtype=bool)).reshape(F, 3, F, 3)
        depth = np.einsum("fi,fifj,fj->f", N, C, N)
        np.testing.assert_allclose(found[:, p] ** 2, depth, rtol=1e-5)
        np.testing.assert_allclose(np.einsum("fifi->f", C), depth, rtol=1e-5)  # images are exact


def test_cameras_at_rest_say_nothing_of_depth() -> None:
    S, R = walks(7), orbit(F, 0.0)
    C = dense(S, R, 2, np.zeros(F, dtype=bool)).reshape(F, 3, F, 3)
    np.testing.assert_allclose(deviations(S, R)[:, 2] ** 2, C[:, 0, :, 0].diagonal(), rtol=1e-6)
    turning = [deviations(S, orbit(F, degrees)).mean() for degrees in (0.0, 0.3, 1.0, 5.0)]
    assert turning == sorted(turning, reverse=True)


def test_gaps_leave_no_less_open(small_scene: Scene) -> None:
    """Every variance is at least that of whole tracks, and that of a track's hidden points grows with the gap."""
    S, R = present(small_scene.structure), present(small_scene.cameras)
    whole = deviations(S, R)
    visible = np.ones(whole.shape, dtype=bool)
    visible[10:14, 3] = visible[10:25, 5] = False
    found = deviations(S, R, visible)
    np.testing.assert_allclose(found[visible], whole[visible])
    assert (found > whole)[~visible].all()
    excess = found**2 - whole**2
    assert excess[10:25, 5].max() / whole[12, 5] ** 2 > excess[10:14, 3].max() / whole[12, 3] ** 2


@pytest.mark.parametrize("factor", [1e-3, 40.0])
def test_units_order_and_axes_do_not_matter(factor: float, rng: np.random.Generator) -> None:
    S, R = walks(9), orbit(F, 6.0)
    found = deviations(S, R)
    np.testing.assert_allclose(deviations(factor * S, R), factor * found, rtol=1e-6)
    order = rng.permutation(9)
    np.testing.assert_allclose(deviations(S[:, :, order], R), found[:, order], rtol=1e-6)
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    np.testing.assert_allclose(deviations(Q @ S, R @ Q.T), found, rtol=1e-6)
