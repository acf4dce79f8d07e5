"""Markers of C3D files, with one clear line about a file that cannot be used.

The header is checked here, before memory is taken. ezc3d reads the rest in a guarded process
(:mod:`nrsfm.datasets.readers.guarded`), since damaged files crash or hang it.

References
----------
Motion Lab Systems, "The C3D file format"; Michaud, Begon, "ezc3d: an easy C3D file I/O cross-platform solution",
JOSS 2021.
"""

from __future__ import annotations

import importlib.util
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nrsfm.datasets.body import Array, observed
from nrsfm.datasets.errors import DatasetError, existing
from nrsfm.datasets.readers.guarded import Damaged, read_guarded

LARGEST = 20_000_000  # positions in one file
BLOCK = 512
INTEL, DEC = 84, 85
BYTES_A_POSITION = 512  # of memory


@dataclass(frozen=True)
class Markers:
    """Markers of a C3D file.

    Parameters
    ----------
    labels : tuple of str
        A label for each marker, as stored.
    points : (F, 3, M) array
        Positions in ``unit``; NaN where a marker was not seen: residual -1, NaN, or all zero.
    rate : float
        Frames a second.
    first_frame : int
        Number of the first frame in the recording that the file was cut from, counted from 1.
    unit : str
        Unit of length, as stored: ``mm``, ``cm``, ``m``.
    """

    labels: tuple[str, ...]
    points: Array
    rate: float
    first_frame: int
    unit: str


def read_c3d(path: Path) -> Markers:
    """Read the markers of a C3D file.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If ezc3d is not installed, or the file cannot be read, is cut short, holds no points, or its header, parameters
        and points disagree.
    """
    existing(path, "set NRSFM_DATA to the folder that holds {folder}/")
    if importlib.util.find_spec("ezc3d") is None:
        raise DatasetError("C3D files are read with ezc3d, which is not installed; pip install 'nrsfm[umpm]'")
    try:
        frames, points, first = _header(path)
        stored = read_guarded("c3d", path, BYTES_A_POSITION * frames * points)
        if stored["points"].shape != (frames, 3, points):
            n, _, m = stored["points"].shape
            raise Damaged(f"its header states {frames} frames of {points} points, {n} of {m} were found")
        if len(stored["labels"]) < points:
            raise Damaged(f"it holds {points} points and {len(stored['labels'])} labels")
        rate = float(stored["rate"])
        if not 0 < rate < np.inf:
            raise Damaged(f"its rate is {rate:g} frames a second")
    except (OSError, Damaged) as error:
        reason = " ".join(str(error).split())
        raise DatasetError(f"{path}: not a readable C3D file ({reason}); export or fetch it again") from None
    P = stored["points"]
    unseen = ~observed(P) | (P == 0).all(axis=1)
    labels = tuple(str(label) for label in stored["labels"][:points])
    return Markers(labels, np.where(unseen[:, None], np.nan, P), rate, first, str(stored["unit"]))


def _header(path: Path) -> tuple[int, int, int]:
    """Number of frames, points of a frame, and the first frame's number; Damaged if the file is too short for them."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(BLOCK)
        if len(head) < BLOCK or head[1] != 0x50:
            raise Damaged("its head is not that of a C3D file")
        stream.seek((head[0] - 1) * BLOCK if head[0] else size)
        section = stream.read(4)
    if len(section) < 4:
        raise Damaged("its parameters are not there")
    if section[3] not in (INTEL, DEC):
        raise Damaged(f"its numbers are of kind {section[3]}, of which 84 (Intel) and 85 (DEC) can be read")
    points, analog, first, last = struct.unpack_from("<4H", head, 2)
    (start,) = struct.unpack_from("<H", head, 16)
    as_float = head[15 if section[3] == INTEL else 13] & 0x80  # a negative scale
    frames = last - first + 1
    if points == 0:
        raise Damaged("it holds no points")
    if frames < 1 or start <= head[0]:
        raise Damaged(f"its header states frames {first} to {last}, from block {start} on")
    if frames * points > LARGEST:
        raise Damaged(f"it holds {frames * points} positions, more than {LARGEST}; cut it into shorter takes")
    lacking = (start - 1) * BLOCK + frames * (4 * points + analog) * (4 if as_float else 2) - size
    if lacking > 0:
        raise Damaged(f"it is cut short: {lacking} bytes of {frames} frames of {points} points are not there")
    return frames, points, first
