"""Labels by a rotation of eigenvectors: optimality of both steps, invariance, and clusters that stand apart."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.spatial.transform import Rotation

from nrsfm.harness.evaluate.errors import n_wrong
from nrsfm.methods.clustering.multiclass import discretise, rotation_cut
from nrsfm.methods.clustering.spectral import CUTS, spectral_clustering
from tests.methods.clustering.test_clustering import blocks


def spread_rows(rng: np.random.Generator, n: int, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit rows about the axes of space, in another frame, and the axis of each."""
    labels = rng.integers(3, size=n)
    rows = np.eye(3)[labels] + noise * rng.standard_normal((n, 3))
    turned = rows @ Rotation.random(rng=rng).as_matrix()
    return turned / np.linalg.norm(turned, axis=1, keepdims=True), labels


def fit(X: np.ndarray, labels: np.ndarray) -> float:
    """The least |L - X R|^2 over orthogonal R, by the polar factor."""
    L = np.eye(X.shape[1])[labels]
    return float(np.sum(L**2) + np.sum(X**2) - 2 * np.linalg.svd(L.T @ X, compute_uv=False).sum())


def test_rows_near_a_rotated_axis_get_its_label(rng: np.random.Generator) -> None:
    X, labels = spread_rows(rng, 60, 0.1)
    assert n_wrong(discretise(X), labels) == 0


def test_no_other_label_of_a_track_fits_better(rng: np.random.Generator) -> None:
    X, _ = spread_rows(rng, 60, 0.4)
    labels = discretise(X)
    least = fit(X, labels)
    for i in range(60):
        for other in range(3):
            changed = labels.copy()
            changed[i] = other
            U, _, Vt = np.linalg.svd(np.eye(3)[labels].T @ X)
            assert np.sum((np.eye(3)[changed] - X @ (Vt.T @ U.T)) ** 2) >= least - 1e-9


def test_labels_do_not_depend_on_the_frame_of_the_eigenvectors(rng: np.random.Generator) -> None:
    X, _ = spread_rows(rng, 60, 0.4)
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    assert n_wrong(discretise(X @ Q), discretise(X)) == 0


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("sparse", [False, True])
def test_every_cut_finds_groups_that_hardly_touch(rng: np.random.Generator, cut: str, sparse: bool) -> None:
    A = 5 * blocks(rng, apart=False)
    assert n_wrong(spectral_clustering(sp.csr_array(A) if sparse else A, 3, cut=cut), np.repeat([0, 1, 2], 30)) == 0


def test_weakly_joined_points_are_not_cut_off_alone() -> None:
    """Two groups of 20, and one point that hangs by a thread: the regularised cut parts the groups."""
    A = np.pad(np.kron(np.eye(2), np.ones((20, 20))) + 0.01, (0, 1)).astype(np.float64)
    A[-1, 0] = A[0, -1] = 1e-3
    labels = rotation_cut(A, 2)
    assert n_wrong(labels[:-1], np.repeat([0, 1], 20)) == 0
