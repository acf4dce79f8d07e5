"""Edges join points that keep their distance, body by body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nrsfm.reports.figures.skeleton import MOST, stable_edges


def chain(n: int, frames: int, seed: int) -> NDArray[np.float64]:
    """A chain of n joints with bones of length 1 that bend at random (F, 3, n)."""
    steps = np.random.default_rng(seed).standard_normal((frames, 3, n))
    return np.cumsum(steps / np.linalg.norm(steps, axis=1, keepdims=True), axis=2)


def test_the_bones_of_a_chain_are_found() -> None:
    edges = stable_edges(chain(8, 60, 0))
    assert {tuple(edge) for edge in edges.tolist()} == {(i, i + 1) for i in range(7)}


def test_edges_follow_their_points_and_stay_inside_bodies() -> None:
    X = np.concatenate([chain(5, 60, 1), 3 + chain(4, 60, 2)], axis=2)
    labels = np.array([0] * 5 + [1] * 4)
    order = np.random.default_rng(3).permutation(9)
    edges = stable_edges(X[:, :, order], labels[order])
    assert {tuple(sorted(order[list(edge)].tolist())) for edge in edges.tolist()} == {
        (i, i + 1) for i in range(8) if i != 4
    }


def test_a_rigid_body_is_joined_by_its_shortest_tree() -> None:
    line = np.zeros((5, 3, 4))
    line[:, 0] = [0.0, 3.0, 1.0, 2.0]
    assert {tuple(edge) for edge in stable_edges(line).tolist()} == {(0, 2), (2, 3), (1, 3)}


def test_single_points_and_surfaces_have_none() -> None:
    assert stable_edges(np.zeros((3, 3, 1))).shape == (0, 2)
    assert stable_edges(np.zeros((3, 3, MOST + 1))).shape == (0, 2)
