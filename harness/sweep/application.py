"""The Hydra application of ``nrsfm run``, of which each worker is one job with any launcher but ``basic``."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import hydra
from omegaconf import DictConfig

from nrsfm.harness.sweep.work import Work, go_through


def worker(cfg: DictConfig) -> None:
    """Run the trials of the work file that the configuration names, until none is left."""
    path = Path(cfg.work)
    if path.is_file():  # otherwise the sweep has ended
        go_through(Work.read(path))


_main = hydra.main(config_path="pkg://nrsfm.conf", config_name="config", version_base="1.3")(worker)


def call_hydra(argv: Sequence[str]) -> int:
    """Run Hydra's own command line; returns its exit code. Its errors are raised, not printed."""
    before = sys.argv
    sys.argv = ["nrsfm run", *argv]
    os.environ["HYDRA_FULL_ERROR"] = "1"
    try:
        _main()
    except SystemExit as stop:
        return int(stop.code or 0)
    finally:
        sys.argv = before
    return 0
