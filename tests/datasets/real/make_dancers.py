"""Makes ``datasets/shipped/dancers.npz`` from a whole take of two people: fewer frames, no fingers, 1/1024 m."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from nrsfm.datasets.readers.npzfile import read_npz
from nrsfm.datasets.real.two_person import FIRST, people_of

STRIDE, STEPS = 6, 1024


def main(take: Path, shipped: Path) -> None:
    """Write the compact file; the joints that are left out are ends of the tree, so that parents stay in it."""
    people, names, parents, dt, body = people_of(take, read_npz(take))
    place = np.cumsum(body) - 1
    arrays: dict[str, Any] = {
        person: (np.round(X[FIRST::STRIDE, body] * STEPS) / STEPS).astype(np.float32) for person, X in people.items()
    }
    kept = np.where(parents[body] < 0, -1, place[parents[body]])
    arrays |= {"names": names[body], "parents": kept, "dt": np.array(dt * STRIDE)}
    np.savez_compressed(shipped, **arrays)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
