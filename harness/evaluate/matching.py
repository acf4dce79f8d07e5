"""Matching of clusters to bodies."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from nrsfm.methods.base import Labels


def matched(labels: Labels, truth: Labels | None) -> Labels:
    """Clusters (P,) renamed to the bodies that they match best one to one, so that colours mean bodies.

    Clusters without a body take the next free names. Without the truth nothing is renamed.
    """
    if truth is None:
        return labels
    clusters, cluster = np.unique(labels, return_inverse=True)
    bodies, body = np.unique(truth, return_inverse=True)
    overlap = np.zeros((len(clusters), len(bodies)), dtype=int)
    np.add.at(overlap, (cluster, body), 1)
    rows, columns = linear_sum_assignment(-overlap)
    names = np.full(len(clusters), -1)
    names[rows] = bodies[columns]
    spare = names < 0
    names[spare] = bodies.max() + 1 + np.arange(spare.sum())
    return np.asarray(names[cluster], dtype=np.int64)


def readable(body: str) -> str:
    """A body's name for readers: ``label 2`` where it is a mere number."""
    return f"label {body}" if body.lstrip("-").isdigit() else body
