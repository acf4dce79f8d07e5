"""Scenes of a user's own tracks: read from a file, cleaned, and checked against the truth in the file."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array, centre, observed
from nrsfm.datasets.cameras import project
from nrsfm.datasets.errors import DatasetError, existing
from nrsfm.datasets.public.catalogue import sha256
from nrsfm.datasets.readers.arrayfields import FIELDS
from nrsfm.datasets.readers.csvfile import read_csv
from nrsfm.datasets.readers.limits import HUGE
from nrsfm.datasets.readers.posefile import read_json
from nrsfm.datasets.readers.trackfields import read_fields
from nrsfm.datasets.readers.trackfile import RECOGNISED, Asked, TrackFile
from nrsfm.datasets.real.take import load_c3d
from nrsfm.datasets.scene import Scene

Reader = Callable[[Path, Asked], TrackFile]
READERS: Mapping[str, Reader] = {
    **dict.fromkeys(FIELDS, read_fields),
    **dict.fromkeys((".csv", ".tsv", ".txt"), read_csv),
    ".json": read_json,
}
SUFFIXES = (*READERS, ".c3d")
OTHERS = {  # known kinds that are not read, and what to do
    **dict.fromkeys((".pkl", ".pickle", ".pt", ".pth", ".joblib"), "it runs code when it is read; save .npz instead"),
    ".slp": "export it as SLEAP's analysis .h5 or .csv",
}
LARGEST = 2**32  # bytes of a file
ROUND_OFF = 1e-4  # by which camera rows of a file may fail to be orthonormal
UNEXPLAINED = 0.5  # share of the tracks that the true structure may leave unexplained
ROUNDS = 100
NEGATIVE = 0.25  # share of negative coordinates: 0 in pixels, 0.5 where tracks are centred
MISSING = (0.0, -1.0)  # x and y of what some programs write where nothing was observed
DOWN = "y points down, as in images, and was turned up; if it points up, say --y up"
C3D = "markers in 3D, at most 400 frames of them, before an orthographic camera that circles at 5 degrees a frame"


def load(settings: Mapping[str, Any], folder: Path) -> Scene:
    """The scene of the settings of ``conf/dataset/tracks.yaml``: see :func:`load_tracks`."""
    given = {name: settings[name] for name in ("columns", "axes", "confidence", "y") if settings.get(name) is not None}
    return load_tracks(find(settings["file"], folder), settings["name"], Asked(**given))


def digest(settings: Mapping[str, Any], folder: Path) -> str:
    """SHA-256 of the file, or of the names and contents of a folder's .json files."""
    path = find(settings["file"], folder)
    return _digest(_existing(path, "dataset.file names a file from the current folder or the data folder"))


def load_tracks(path: Path, name: str | None = None, asked: Asked = RECOGNISED) -> Scene:
    """Read tracks, and cameras, truth and labels where the file has them.

    The layouts of array files are those of :func:`nrsfm.datasets.readers.trackfields.read_fields`, of text tables those
    of :func:`nrsfm.datasets.readers.csvfile.read_csv`, of JSON files and folders of them those of
    :func:`nrsfm.datasets.readers.posefile.read_json`. Markers of a .c3d file are seen by an orbiting camera, as with
    ``dataset=c3d`` and its settings.

    Frames that show fewer than two tracks, and tracks that are seen in fewer than two frames, are left out: no method
    can place them. In images y points down: there the tracks, and the cameras of the file, are turned over, so that y
    points up in every scene. There positions (0, 0) and (-1, -1) count as not observed. Tracks are centred per frame. A
    true structure is scaled to the units of the tracks. The scene's ``notes`` list these changes.

    The scene's name is by default made from the file's.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If it is of another kind, cannot be read, or its fields do not fit each other. One line, with the remedy.
    """
    _existing(path, f"name a file of tracks ({', '.join(SUFFIXES)})")
    suffix = path.suffix.lower()
    if path.is_dir():
        return _scene(path, read_json(path, asked), name or title(path), asked)
    if suffix not in SUFFIXES:
        wanted = OTHERS.get(suffix, f"it is of no known kind; wanted {', '.join(SUFFIXES)}")
        raise DatasetError(f"{path}: {wanted}")
    if path.stat().st_size > LARGEST:
        raise DatasetError(f"{path} has more than {LARGEST >> 30} GiB; leave frames or tracks out")
    if suffix == ".c3d":
        return replace(load_c3d(path, name=name or title(path)), notes=(C3D,))
    return _scene(path, READERS[suffix](path, asked), name or title(path), asked)


def _existing(path: Path, remedy: str) -> Path:
    return path if path.is_dir() else existing(path, remedy)


def _digest(path: Path) -> str:
    if not path.is_dir():
        return sha256(path)
    lines = "".join(f"{part.name} {sha256(part)}\n" for part in sorted(path.glob("*.json")))
    return hashlib.sha256(lines.encode("utf-8", "surrogateescape")).hexdigest()


def title(file: str | Path) -> str:
    """A scene's name, made from its file's name."""
    return re.sub(r"[^A-Za-z0-9._+-]+", "_", Path(file).stem)[:60].strip("_") or "tracks"


def find(file: object, folder: Path) -> Path:
    """Path of ``dataset.file`` in the current folder or, if it is not there, in the data folder."""
    if not isinstance(file, str) or not file:
        raise DatasetError(f"dataset.file is {file!r}, wanted the name of a file of tracks")
    path = Path(file).expanduser()
    return path if path.exists() or path.is_absolute() else folder / path


def _scene(path: Path, parts: TrackFile, name: str, asked: Asked) -> Scene:
    _check_numbers(path, parts)
    W, notes = parts.tracks, list(parts.notes)
    down = asked.y == "down" or (asked.y == "auto" and (parts.image or _is_image(W)))
    W, told = _without_marks(W, down)
    notes += told
    if down:
        W = W * DOWNWARDS
        parts = replace(parts, cameras=None if parts.cameras is None else parts.cameras * DOWNWARDS)
        notes += [DOWN] if asked.y == "auto" else []
    seen = observed(W)
    frames, points = _kept(path, seen)
    for kept, ids, word, less in (
        (frames, parts.frames, "frame", "show fewer than two tracks"),
        (points, parts.ids, "track", "are seen in fewer than two frames"),
    ):
        if not kept.all():
            notes.append(f"left out: {_list(word, [ids[k] for k in np.flatnonzero(~kept)])}, which {less}")
    W, seen = W[frames][:, :, points], seen[np.ix_(frames, points)]
    W = centre(W)
    structure = None if parts.structure is None else parts.structure[frames][:, :, points]
    cameras = None if parts.cameras is None else _orthonormal(path, parts.cameras[frames])
    if structure is not None:
        structure, note = _scaled(path, W, seen, structure, cameras)
        notes += [note] if note else []
    labels, bodies = parts.labels, parts.bodies
    if labels is not None:
        present, labels = np.unique(labels[points], return_inverse=True)
        bodies = tuple(bodies[k] for k in present)
    return Scene(
        name=name,
        tracks=W,
        bodies=bodies,
        labels=labels,
        structure=structure,
        cameras=cameras,
        visible=None if seen.all() else seen,
        digest=_digest(path),
        track_ids=tuple(parts.ids[k] for k in np.flatnonzero(points)),
        frame_ids=tuple(parts.frames[k] for k in np.flatnonzero(frames)),
        notes=tuple(notes),
    )


DOWNWARDS = np.array([[1.0], [-1.0]])  # turns y over


def _is_image(W: Array) -> bool:
    """Whether (F, 2, P) tracks seem to be measured from a corner of the image: hardly a coordinate is negative."""
    values = W[np.isfinite(W) & ~np.isin(W, MISSING)]
    return values.size > 0 and float(np.mean(values < 0)) < NEGATIVE


def _without_marks(W: Array, down: bool) -> tuple[Array, list[str]]:
    """The tracks with NaN for positions in an image that mark what was not observed, and notes on such positions."""
    notes = []
    for mark in MISSING:
        marked: NDArray[np.bool_] = np.all(mark == W, axis=1)
        if (count := int(marked.sum())) > 1 and (down or count > 0.01 * marked.size):
            told = " and count as not observed" if down else "; if those were not observed, write NaN"
            notes.append(f"{count} positions are exactly ({mark:g}, {mark:g}){told}")
            W = np.where(marked[:, None], np.nan, W) if down else W
    return W, notes


def _check_numbers(path: Path, parts: TrackFile) -> None:
    """Raise DatasetError on infinite numbers, positions with one NaN coordinate, and gaps in the truth."""

    def first(bad: NDArray[np.bool_]) -> str:
        frame, track = np.argwhere(bad)[0]
        return f"frame {parts.frames[frame]}, track {parts.ids[track]}"

    for value in (parts.tracks, parts.structure, parts.cameras):
        if value is not None and (np.abs(value[np.isfinite(value)]) > HUGE).any():
            raise DatasetError(f"{path}: it holds numbers above {HUGE:g}; bring it to other units")
    W = parts.tracks
    if np.isinf(W).any():
        raise DatasetError(
            f"{path}: {first(np.asarray(np.isinf(W).any(axis=1)))} is infinite; write NaN where it is not observed"
        )
    nan = np.isnan(W)
    if (half := nan[:, 0] != nan[:, 1]).any():
        raise DatasetError(f"{path}: {first(half)} has one coordinate alone; write both, or neither")
    if parts.structure is not None:
        bad = np.asarray(np.isinf(parts.structure).any(axis=1) | (~observed(parts.structure) & ~nan[:, 0]))
        if bad.any():
            raise DatasetError(f"{path}: the structure of {first(bad)} is NaN or infinite; leave the structure out")
    if parts.cameras is not None and not np.isfinite(parts.cameras).all():
        raise DatasetError(f"{path}: the cameras hold NaN or infinite values; leave them out to have them estimated")


def _kept(path: Path, seen: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Frames (F,) and tracks (P,) that are kept: each frame shows two kept tracks, each track is in two kept frames."""
    frames, points = np.ones(seen.shape[0], dtype=bool), np.ones(seen.shape[1], dtype=bool)
    for _ in range(ROUNDS):
        part = seen & frames[:, None] & points
        enough = part.sum(axis=1) >= 2, part.sum(axis=0) >= 2
        if np.array_equal(enough[0], frames) and np.array_equal(enough[1], points):
            break
        frames, points = enough
    else:
        frames = np.zeros_like(frames)
    if frames.sum() < 2 or points.sum() < 2:
        raise DatasetError(
            f"{path}: {int(seen.sum())} observations in {seen.shape[0]} frames of {seen.shape[1]} tracks are too few; "
            "wanted two tracks and two frames at least, each track in two frames and two tracks in each frame"
        )
    return frames, points


def _list(word: str, ids: Sequence[str]) -> str:
    """Words such as ``3 frames (7, 8, 9)``."""
    shown = ", ".join(ids[:5]) + (", ..." if len(ids) > 5 else "")
    return f"{len(ids)} {word}{'' if len(ids) == 1 else 's'} ({shown})"


def _orthonormal(path: Path, cameras: Array) -> Array:
    """The nearest cameras with orthonormal rows; DatasetError if they are further away than round-off."""
    off = float(np.abs(cameras @ cameras.transpose(0, 2, 1) - np.eye(2)).max())
    if not off < ROUND_OFF:
        raise DatasetError(
            f"{path}: the cameras' rows are not orthonormal (off by {off:.2g}); divide tracks and camera of each frame "
            "by its scale, or leave the cameras out to have them estimated"
        )
    U, _, Vt = np.linalg.svd(cameras, full_matrices=False)
    return np.asarray(U @ Vt)


def _scaled(
    path: Path, W: Array, seen: NDArray[np.bool_], structure: Array, cameras: Array | None
) -> tuple[Array, str]:
    """The true structure, centred per frame, in the units of the tracks; and a note if it was scaled, else "".

    Without cameras, affine ones are fitted to each frame. Their rows have the length of the scale if the true cameras
    are orthographic.
    """
    S = np.where(seen[:, None], structure, 0)
    S = np.where(seen[:, None], S - S.sum(axis=2, keepdims=True) / seen.sum(axis=1)[:, None, None], 0)
    X = np.nan_to_num(W)
    if cameras is None:
        A = (X @ S.transpose(0, 2, 1)) @ np.linalg.pinv(S @ S.transpose(0, 2, 1), rcond=1e-9, hermitian=True)
        image = A @ S
        size = float(np.sqrt(np.mean(np.sum(A**2, axis=(1, 2)) / 2)))
    else:
        image = project(cameras, S)
        size = max(0.0, float(np.sum(image * X) / max(np.sum(image**2), np.finfo(float).tiny)))
        image = size * image
    left = float(np.linalg.norm(X - image) / max(np.linalg.norm(X), np.finfo(float).tiny))
    if not left < UNEXPLAINED:
        raise DatasetError(
            f"{path}: the structure leaves {left:.0%} of the tracks unexplained; its rows are x, y, z for each frame, "
            "and it is what the cameras see; mend it or leave it out"
        )
    S = centre(structure)
    if abs(size - 1) < 0.05:  # noise on the tracks does as much
        return S, ""
    return size * S, f"the true structure was scaled by {size:.6g} to the units of the tracks"
