"""The eight motion-capture sequences of the non-rigid structure-from-motion literature.

drink, pickup, yoga, stretch, dance: Akhter, Sheikh, Khan, Kanade, "Trajectory Space", PAMI 2011.
face, walking, shark: Torresani, Hertzmann, Bregler, PAMI 2008 (the shark is stored as ``jaws``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from datasets.body import Array, Body, DatasetError, no_edges, register
from datasets.matfile import read_mat
from datasets.scene import Scene, compose
from datasets.sources import sha256


@dataclass(frozen=True)
class Sequence_:
    """Where a sequence's numbers are and how they are laid out.

    ``interleaved`` files hold S (3F, P) with rows x, y, z per frame; ``blocks`` hold P3_gt (3F, P) with F rows
    of x, then of y, then of z. ``registered`` says how the body's own rotation is removed: it ``stored``
    already, by ``procrustes`` analysis, or in a ``cameras`` file that holds the registered shape.
    """

    file: str
    n_frames: int
    n_points: int
    layout: str = "interleaved"
    registered: str = "stored"

    @property
    def vertical(self) -> str:
        return "z" if self.layout == "interleaved" else "y"


SEQUENCES: Mapping[str, Sequence_] = {
    "drink": Sequence_("drink.mat", 1102, 41),
    "pickup": Sequence_("pickup.mat", 357, 41),
    "yoga": Sequence_("yoga.mat", 307, 41),
    "stretch": Sequence_("stretch.mat", 370, 41),
    "dance": Sequence_("dance.mat", 264, 75, registered="procrustes"),
    "face": Sequence_("face.mat", 316, 40, layout="blocks", registered="procrustes"),
    "walking": Sequence_("walking.mat", 260, 55, layout="blocks", registered="procrustes"),
    "shark": Sequence_("jaws.mat", 240, 91, layout="blocks", registered="cameras"),
}
SHARK_CAMERAS = "jaws_cameras.mat"
MOTIONS = ("registered", "native")
