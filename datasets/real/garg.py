"""Garg et al.'s dense sequences: a point for every pixel of a face, a back, a heart.

Garg, Roussos, Agapito, "Dense variational reconstruction of non-rigid surfaces from monocular video", CVPR 2013.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nrsfm.datasets.body import Array, centre
from nrsfm.datasets.errors import DatasetError, check_whole, existing
from nrsfm.datasets.public.catalogue import sha256
from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.datasets.real.neighbours import even_choice, nearest_edges, on_pixels, pixel_edges
from nrsfm.datasets.scene import Scene

FIELDS = {"tracks": "W", "structure": "S"}
FIT = 0.02  # largest share of the tracks that the true structure may leave unexplained


@dataclass(frozen=True)
class Sequence:
    """Sizes of a sequence where they are known, and whether its file holds the true structure."""

    n_frames: int | None = None
    n_points: int | None = None
    truth: bool = True


SEQUENCES: Mapping[str, Sequence] = {
    "face1": Sequence(10, 28_880),
    "face2": Sequence(10, 28_880),
    "face3": Sequence(99, 28_880),
    "face4": Sequence(99, 28_880),
    "real_face": Sequence(truth=False),
    "back": Sequence(truth=False),
    "heart": Sequence(truth=False),
}


def path(folder: Path, sequence: str) -> Path:
    """The file of a sequence, ``garg/NAME.mat``.

    Raises
    ------
    DatasetError
        If there is no such sequence, with the names of all; MissingData if the file is not there.
    """
    if sequence not in SEQUENCES:
        raise DatasetError(f"dataset.sequence is {sequence!r}, wanted one of {', '.join(SEQUENCES)}")
    return existing(
        folder / "garg" / f"{sequence}.mat", "its authors give it out on request, and no generated data takes its place"
    )


def load(settings: Mapping[str, Any], folder: Path) -> Scene:
    """Read one sequence.

    Parameters
    ----------
    settings : mapping
        Those of ``conf/dataset/garg.yaml``. ``fields`` names the file's tracks (2F, P), F rows of x and then F rows of
        y, and its structure (3F, P), rows x, y, z for each frame or three blocks of F rows. Of these two layouts, the
        one that explains the tracks is taken.
    folder : Path
        The data folder, which holds ``garg/``.

    Returns
    -------
    Scene
        One body. With true structure the cameras are those that see it as the tracks do, rows orthonormal, and the
        structure is in the units of the tracks; without, cameras and structure are None. Points of the first image that
        lie on pixels of their own, all of them kept, are joined along the pixel grid, others to their nearest
        ``neighbours``.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If a setting is out of range, the file cannot be read, or its fields do not fit each other.
    """
    sequence, frames = settings["sequence"], settings["frames"]
    file, known = path(folder, sequence), SEQUENCES[sequence]
    names = FIELDS | dict(settings["fields"] or {})
    tracks_field, truth_field = str(names["tracks"]), str(names["structure"])
    fields = read_mat(file, [tracks_field, truth_field] if known.truth else [tracks_field])
    W = _tracks(file, tracks_field, fields[tracks_field], known)
    if frames is not None:
        check_whole("dataset.frames", frames, 2, len(W), f" for {sequence}")
    check_whole("dataset.neighbours", settings["neighbours"], 1)
    structure = cameras = None
    if known.truth:
        structure, cameras = _truth(file, truth_field, fields[truth_field], W)
    chosen = even_choice(W[0], settings["points"])
    pixels = on_pixels(W[0]) if len(chosen) == W.shape[2] else None
    W = W[:frames, :, chosen]
    if structure is not None and cameras is not None:
        structure, cameras = centre(structure[:frames, :, chosen]), cameras[:frames]
    return Scene(
        name=settings["name"] or sequence,
        tracks=centre(W),
        bodies=(sequence,),
        labels=np.zeros(len(chosen), dtype=np.int64),
        structure=structure,
        cameras=cameras,
        edges=nearest_edges(W[0], settings["neighbours"]) if pixels is None else pixel_edges(pixels),
        digest=sha256(file),
    )


def digest(settings: Mapping[str, Any], folder: Path) -> str:
    """SHA-256 of the sequence's file."""
    return sha256(path(folder, settings["sequence"]))


def _tracks(file: Path, field: str, stacked: Array, known: Sequence) -> Array:
    """Tracks (F, 2, P) from the stacked (2F, P); DatasetError unless they are finite and of the sequence's size."""
    rows, P = stacked.shape if stacked.ndim == 2 else (0, 0)
    F = known.n_frames or rows // 2
    if rows != 2 * F or F < 2 or P < 2 or (known.n_points and known.n_points != P):
        wanted = f"({2 * F}, {known.n_points})" if known.n_points else "(2F, P)"
        raise DatasetError(f"{file}: field {field} has shape {stacked.shape}, wanted {wanted}; is it the right file?")
    _check_finite(file, field, stacked)
    return np.ascontiguousarray(stacked.reshape(2, F, P).transpose(1, 0, 2))


def _truth(file: Path, field: str, stacked: Array, W: Array) -> tuple[Array, Array]:
    """Structure (F, 3, P) in the units of the tracks, and the cameras (F, 2, 3) that see it as W."""
    F, _, P = W.shape
    if stacked.shape != (3 * F, P):
        raise DatasetError(f"{file}: field {field} has shape {stacked.shape}, wanted ({3 * F}, {P})")
    _check_finite(file, field, stacked)
    layouts = (stacked.reshape(F, 3, P), stacked.reshape(3, F, P).transpose(1, 0, 2))
    fits = [_orthographic(centre(S), centre(W)) for S in layouts]
    structure, cameras, off = min(fits, key=lambda fit: fit[2])
    if not off <= FIT:
        raise DatasetError(
            f"{file}: field {field}, as rows x, y, z for each frame or in three blocks, leaves {off:.0%} of the tracks "
            f"unexplained by any orthographic camera (at most {FIT:.0%} may be); is it of this sequence?"
        )
    return structure, cameras


def _check_finite(file: Path, field: str, value: Array) -> None:
    if not np.isfinite(value).all():
        raise DatasetError(f"{file}: field {field} holds NaN or infinite values; fetch the file again")


def _orthographic(S: Array, W: Array) -> tuple[Array, Array, float]:
    """S scaled as a whole, the cameras with orthonormal rows nearest to W = R S, and the share of W left over."""
    gram = S @ S.transpose(0, 2, 1)
    A = (W @ S.transpose(0, 2, 1)) @ np.linalg.pinv(gram, hermitian=True)
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    cameras = U @ Vt
    S = S * float(s.mean())
    return S, cameras, float(np.linalg.norm(W - cameras @ S) / (np.linalg.norm(W) or 1.0))
