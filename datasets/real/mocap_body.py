"""One of the motion-capture sequences alone, before its own cameras, as the single-body literature has it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from nrsfm.datasets.body import Body, centre
from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.composition import view
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.datasets.real.mocap import body_digest, expect, file_of, load_body, recording
from nrsfm.datasets.scene import Scene


def load(settings: Mapping[str, Any], folder: Path) -> Scene:
    """The scene of the settings of ``conf/dataset/mocap_body.yaml``."""
    return load_single(folder, settings["body"], scene=settings["name"], stand_in=settings["stand_in"])


def digest(settings: Mapping[str, Any], folder: Path) -> str:
    """SHA-256 of the sequence's file, or the generator's version."""
    return body_digest(folder, settings["body"], "native", settings["stand_in"])


def load_single(folder: Path, name: str, *, scene: str | None = None, stand_in: bool = False) -> Scene:
    """A scene of one sequence; ``scene`` is its name, by default the sequence's. See :func:`load_recording`."""
    return view(load_recording(folder, name, stand_in), scene)


def load_recording(folder: Path, name: str, stand_in: bool = False) -> Body:
    """Read one sequence as it is stored, with its own cameras: the field ``Rs``, or a fixed camera.

    The body keeps its own motion (``native``). A stand-in is seen by a camera that circles at 5 degrees a frame.
    Parameters and exceptions as for :func:`nrsfm.datasets.real.mocap.load_body`. A file whose tracks W are not R S
    raises DatasetError.
    """
    body = load_body(folder, name, "native", stand_in=stand_in)
    camera = recording(name).camera
    if body.stand_in:
        return replace(body, cameras=orbit(body.n_frames))
    if camera != "Rs":
        rows = np.eye(3)[["xyz".index(axis) for axis in camera]]
        return replace(body, cameras=np.tile(rows, (body.n_frames, 1, 1)))
    path = folder / file_of(name, "native")
    fields = read_mat(path, ["Rs", "W"])
    R = expect(path, "Rs", fields, (2 * body.n_frames, 3)).reshape(-1, 2, 3)
    W = expect(path, "W", fields, (2 * body.n_frames, body.n_points)).reshape(-1, 2, body.n_points)
    if not np.allclose(centre(project(R, body.structure)), centre(W), atol=1e-9 * np.abs(W).max()):
        raise DatasetError(f"{path}: the tracks W are not Rs S; fetch the file with 'nrsfm data get'")
    return replace(body, cameras=R)
