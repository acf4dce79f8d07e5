"""Tracks of the points of several bodies, a row for each body in a frame: wide tables and files of poses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.trackfile import TrackFile, check_size, in_order, named


def pose_tracks(
    path: Path, frames: Sequence[str], bodies: Sequence[str] | None, nodes: Sequence[str], values: Array
) -> TrackFile:
    """Tracks of each node of each body.

    Parameters
    ----------
    frames, bodies : sequence of str
        The frame and the body of each of R rows; bodies are None where there is but one.
    nodes : sequence of str
        Names of the N points of a body.
    values : (R, N, 2) array
        Positions, NaN where they are not observed.

    Raises
    ------
    DatasetError
        If a body comes twice in a frame, or the file is too large.
    """
    own = list(bodies) if bodies is not None else [""] * len(frames)
    place = {word: k for k, word in enumerate(dict.fromkeys(frames))}
    names, rank = in_order(path, "frame", list(place))
    known = {word: k for k, word in enumerate(dict.fromkeys(own))}
    groups, group_rank = in_order(path, "track", list(known)) if bodies is not None else (("",), np.zeros(1, int))
    F, G, N = len(names), len(groups), len(nodes)
    check_size(path, F, G * N)
    f, g = rank[[place[word] for word in frames]], group_rank[[known[word] for word in own]]
    _, first = np.unique(f * G + g, return_index=True)
    if len(first) < len(f):
        again = int(np.setdiff1d(np.arange(len(f)), first)[0])
        which = f", {own[again][:40]!a}," if bodies is not None else ""
        raise DatasetError(f"{path}: frame {frames[again][:40]!a}{which} occurs twice; leave one of them out")
    W = np.full((F, G, N, 2), np.nan)
    W[f, g] = values
    tracks = W.reshape(F, G * N, 2).transpose(0, 2, 1)
    if G == 1:
        return TrackFile(tracks, names, tuple(nodes))
    ids = tuple(f"{group}.{node}" for group in groups for node in nodes)
    labels, words = named(path, "track", [group for group in groups for _ in nodes])
    return TrackFile(tracks, names, ids, labels=labels, bodies=words)
