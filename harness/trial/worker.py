"""The part of a trial that runs in its own process: make the scene, run the method, compute metrics, write files."""

from __future__ import annotations

import time
import traceback
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.registry import digest, load_scene
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate import metrics
from nrsfm.harness.evaluate.reconstruct import reconstruct
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import ARRAYS, TRACEBACK, pack, write_atomically, write_record
from nrsfm.harness.record.outcome import ABSENT, FAILED, OK, Outcome
from nrsfm.harness.record.trial import AUTO, Trial
from nrsfm.harness.trial.isolation import DISK, peak_mb
from nrsfm.harness.trial.progress import Reporter
from nrsfm.methods.base import MethodError, Progress, stage
from nrsfm.methods.registry import build_method

EXPECTED = (DatasetError, MethodError, UsageError)


def work(
    trial: Trial,
    blank: Outcome,
    data: Path,
    stand_in: bool,
    folder: Path,
    memory_gb: float = float("inf"),
    step: Path | None = None,
) -> None:
    """Run a trial and write its arrays and its record into ``folder``; an exception becomes a record with its text.

    Parameters
    ----------
    blank : Outcome
        The fields that are known before; :func:`compute` checks the data against its digest.
    memory_gb : float
        A method that foresees that it needs more is refused.
    step : Path, optional
        File that is kept up to date with the stage and the iteration.
    """
    start, cpu = time.perf_counter(), time.process_time()
    try:
        outcome, arrays = compute(trial, blank, data, stand_in, memory_gb, Reporter(trial.title, step))
        write_atomically(folder / ARRAYS, lambda handle: np.savez_compressed(handle, **arrays))
    except MemoryError:
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno in DISK:
            raise
        text = " ".join(str(error).split()) or type(error).__name__
        if not isinstance(error, EXPECTED):
            text = f"{type(error).__name__}: {text}"
            (folder / TRACEBACK).write_text(traceback.format_exc())
        status = ABSENT if isinstance(error, MissingData) else FAILED
        outcome = replace(blank, status=status, error=text[:2000])
    outcome = replace(
        outcome,
        seconds=round(time.perf_counter() - start, 4),
        cpu_seconds=round(time.process_time() - cpu, 4),
        peak_mb=round(peak_mb(), 1),
    )
    write_record(folder, outcome)


def compute(
    trial: Trial,
    blank: Outcome,
    data: Path,
    stand_in: bool,
    memory_gb: float = float("inf"),
    progress: Progress | None = None,
) -> tuple[Outcome, Mapping[str, Any]]:
    """Make the scene, run the method and measure; returns an Outcome of status ok and the arrays to keep.

    Raises
    ------
    DatasetError
        If the scene cannot be made, or its data are no longer those of the digest in ``blank``.
    MethodError, UsageError
        If the settings do not fit the scene or the method, or the method would need more than ``memory_gb``.
    """
    stage(progress, "scene")
    scene = load_scene(trial.dataset, data, stand_in)
    identified = blank.environment.get("data", "")
    if identified and digest(trial.dataset, data, stand_in) != identified:  # asked after loading, to leave no gap
        raise DatasetError(f"the data of {trial.dataset['name']} changed after this run began; start it again")
    n_bodies = _n_bodies(trial, scene)
    repeat = trial.noise["repeat"]
    noisy = scene.with_noise(trial.noise["level"], repeat)
    if trial.gaps:
        noisy = noisy.with_gaps(**trial.gaps, repeat=repeat)
    method = build_method({k: v for k, v in trial.method.items() if k != "name"})
    known = trial.cameras["source"] == "known"
    solution = reconstruct(noisy, method, n_bodies, trial.cameras, memory_gb=memory_gb, progress=progress)
    stage(progress, "metrics")
    auto = n_bodies is None
    if auto and solution.labels is not None:
        n_bodies = len(np.unique(solution.labels))
    outcome = replace(
        blank,
        status=OK,
        metrics=metrics.evaluate(noisy, solution, known_cameras=known, counted=auto),
        stand_in=scene.stand_in,
        n_bodies=n_bodies,
        n_points=scene.n_points,
        n_frames=scene.n_frames,
    )
    parts = {
        "structure": solution.structure,
        "labels": solution.labels,
        "affinity": solution.affinity,
        "cameras": solution.cameras,
        "tracks": noisy.tracks,
        "visible": noisy.visible,
        "true_structure": scene.structure,
        "true_labels": scene.labels,
        "edges": scene.edges,
        **metrics.by_frame(noisy, solution, known_cameras=known),
    }
    arrays = pack({name: value for name, value in parts.items() if value is not None})
    return outcome, arrays | {f"history_{name}": values for name, values in solution.history.items()}


def _n_bodies(trial: Trial, scene: Scene) -> int | None:
    """The number of bodies that is passed to the method; None when it is to be estimated."""
    if trial.n_bodies == AUTO:
        return None
    n_bodies = trial.n_bodies or scene.n_bodies
    if not isinstance(n_bodies, int):
        raise UsageError(f"scene {scene.name} does not say how many bodies it has; set n_bodies, or n_bodies=auto")
    if scene.n_bodies is not None and n_bodies != scene.n_bodies:
        raise UsageError(
            f"scene {scene.name} has {scene.n_bodies} {'body' if scene.n_bodies == 1 else 'bodies'} and n_bodies is "
            f"{n_bodies}; leave n_bodies out or choose another scene"
        )
    return n_bodies
