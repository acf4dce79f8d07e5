"""Makes the moving picture of the README: the package's two dancers, from their tracks, by this project's method."""

from __future__ import annotations

import sys
from pathlib import Path

from nrsfm import solve
from nrsfm.datasets.registry import load_scene
from nrsfm.harness.config.compose import data_folder
from nrsfm.harness.config.spans import expand


def main(path: Path) -> None:
    """Write the GIF."""
    ((trial, _),) = expand(["dataset=dancers"])
    solve(load_scene(trial.dataset, data_folder()), n_bodies=2).animate(path)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
