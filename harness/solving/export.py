"""Writers of a solution's files: CSV tables and a sequence of point clouds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import scipy.sparse as sp

from nrsfm.methods.base import Array, Labels
from nrsfm.reports.figures.style import COLOURS

MOST_PAIRS = 2_000_000  # lines of affinity.csv


def write_csv(path: Path, columns: Mapping[str, Any], digits: str | None = None, append: bool = False) -> None:
    """Columns of equal length as a CSV file, numbers in a format such as ``%.6g``; or more lines of that file."""
    mode: Literal["a", "w"] = "a" if append else "w"
    pd.DataFrame(columns).to_csv(
        path, mode=mode, header=not append, index=False, float_format=digits, na_rep="nan", lineterminator="\n"
    )


def write_structure(
    path: Path, structure: Array, frames: Sequence[str], tracks: Sequence[str], labels: Sequence[str] | None
) -> None:
    """An (F, 3, P) structure as a line for each frame and track, in the order of frames; labels one a track."""
    for f, (frame, X) in enumerate(zip(frames, structure, strict=True)):
        columns = {"frame": frame, "track": tracks, "x": X[0], "y": X[1], "z": X[2], "label": labels or ""}
        write_csv(path, columns, "%.8g", append=f > 0)


def write_affinity(path: Path, affinity: Array | sp.sparray, tracks: Sequence[str]) -> None:
    """A line for each pair of tracks with a weight; no file where there are more than :data:`MOST_PAIRS`."""
    upper = sp.triu(sp.coo_array(affinity), k=1, format="coo")
    if upper.nnz <= MOST_PAIRS:
        names = np.array(tracks, dtype=object)
        columns = {"track_a": names[upper.row], "track_b": names[upper.col], "weight": upper.data}
        write_csv(path, columns, "%.6g")


def write_clouds(folder: Path, structure: Array, labels: Labels | None) -> None:
    """A binary .ply for each frame of an (F, 3, P) structure: x, y, z, colour, and the label, -1 for none."""
    F, _, P = structure.shape
    kind = [(axis, "<f4") for axis in "xyz"] + [(c, "u1") for c in ("red", "green", "blue")] + [("label", "<i4")]
    points = np.zeros(P, dtype=kind)
    points["label"] = -1 if labels is None else labels
    palette = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in COLOURS], dtype=np.uint8)
    for name, channel in zip(("red", "green", "blue"), palette.T, strict=True):
        points[name] = channel[np.maximum(points["label"], 0) % len(palette)]
    types = {"<f4": "float", "u1": "uchar", "<i4": "int"}
    properties = "".join(f"property {types[code]} {name}\n" for name, code in kind)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {P}\n{properties}end_header\n".encode("ascii")
    digits = max(4, len(str(F - 1)))
    folder.mkdir()
    for f, X in enumerate(structure):
        for axis, row in zip("xyz", X, strict=True):
            points[axis] = row
        (folder / f"frame_{f:0{digits}d}.ply").write_bytes(head + points.tobytes())
