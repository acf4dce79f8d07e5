"""Hopkins155: tracks of rigid motions in real video, with true labels and no 3D.

Tron, Vidal, "A benchmark for the comparison of 3-D motion segmentation algorithms", CVPR 2007.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from nrsfm.datasets.errors import FETCH, DatasetError, existing
from nrsfm.datasets.public.catalogue import HOPKINS, sha256
from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.datasets.scene import Scene

#: Names of the 155 scenes; the archive also holds ``dancing``, which is not one of them.
SCENES: tuple[str, ...] = tuple(HOPKINS)
#: Names of the 35 scenes of three motions, of which the archive also holds each two (``_g12``, ``_g13``, ``_g23``).
THREE_MOTIONS: tuple[str, ...] = tuple(name for name in SCENES if f"{name}_g12" in SCENES)
TWO_MOTIONS: tuple[str, ...] = tuple(name for name in SCENES if name not in THREE_MOTIONS)


def path(folder: Path, scene: str) -> Path:
    """The file of a scene, ``hopkins155/NAME_truth.mat``.

    Raises
    ------
    DatasetError
        If the name is none of :data:`SCENES`; MissingData if the file is not there.
    """
    if scene not in SCENES:
        raise DatasetError(
            f"dataset.scene is {scene!r}, none of the 155 such as 1R2RC or cars2_06_g23; "
            "'nrsfm data list hopkins155' names them"
        )
    file = folder / "hopkins155" / f"{scene}_truth.mat"
    return existing(file, FETCH.replace("data get", "data get hopkins155"))


def load(settings: Mapping[str, Any], folder: Path) -> Scene:
    """The scene of the settings of ``conf/dataset/hopkins155.yaml``."""
    return load_scene(folder, settings["scene"])


def digest(settings: Mapping[str, Any], folder: Path) -> str:
    """SHA-256 of the scene's file."""
    return sha256(path(folder, settings["scene"]))


def load_scene(folder: Path, scene: str) -> Scene:
    """Read one of :data:`SCENES`.

    Returns
    -------
    Scene
        The first two coordinates of the normalised tracks ``x`` (3, P, F) and the labels ``s`` (P, 1); no cameras
        and no structure.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If there is no such scene, or its file cannot be read or its fields do not fit.
    """
    file = path(folder, scene)
    fields = read_mat(file, ["x", "s"])
    x, s = fields["x"], fields["s"]
    if x.ndim != 3 or x.shape[0] != 3 or s.shape != (x.shape[1], 1):
        raise DatasetError(f"{file}: x has shape {x.shape} and s {s.shape}, wanted (3, P, F) and (P, 1)")
    if not np.isfinite(x).all():
        _, point, frame = np.argwhere(~np.isfinite(x))[0]
        raise DatasetError(
            f"{file}: field x holds NaN or infinite values (first: frame {frame}, point {point}); fetch it with "
            "'nrsfm data get hopkins155'"
        )
    motions, labels = np.unique(s, return_inverse=True)
    if not np.array_equal(motions, np.arange(1, len(motions) + 1)):
        raise DatasetError(f"{file}: field s does not hold the labels 1, 2, ...")
    return Scene(
        name=scene,
        tracks=np.ascontiguousarray(x[:2].transpose(2, 0, 1)),
        bodies=tuple(f"motion {k:g}" for k in motions),
        labels=labels.reshape(-1).astype(np.int64),
        digest=sha256(file),
    )
