"""Files as motion capture software writes them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from nrsfm.datasets.body import Array

WriteC3D = Callable[..., Path]

SIDES = "WREXT WRTOP WRLOW ELBTOP ELBEXT ELBLOW SHLD TOPLEG KNEEFR KNEEBK KNEEIS ANKFR ANKBK ANKIS HEAD WAISTFR WAISTBK"
#: 37 markers of one person, named as UMPM names them.
MARKERS = [*(side + part for side in "LR" for part in SIDES.split()), "FHEAD", "BNECK", "FRNECK"]


@pytest.fixture(scope="session")
def write_c3d() -> WriteC3D:
    """Write (F, 3, M) points with labels; NaN becomes a point of residual -1."""

    def write(path: Path, points: Array, labels: Sequence[str], rate: float = 100.0, unit: str = "mm") -> Path:
        file = ezc3d.c3d()
        point = file["parameters"]["POINT"]
        point["RATE"]["value"], point["UNITS"]["value"] = [rate], [unit]
        point["LABELS"]["value"] = list(labels)
        ones = np.ones((1, points.shape[2], len(points)))
        file["data"]["points"] = np.concatenate([points.transpose(1, 2, 0), ones])
        path.parent.mkdir(parents=True, exist_ok=True)
        file.write(str(path))
        return path

    return write
