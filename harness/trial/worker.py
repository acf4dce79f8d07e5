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
from nrsfm.harness.evaluate.reconstruct import AS_GIVEN, reconstruct
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.fault import place_of
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

    ``blank`` has the fields that are known before; ``step`` is a file that holds the stage and the iteration.
    """
    start, cpu = time.perf_counter(), time.process_time()
    try:
        outcome, arrays = compute(trial, blank, data, stand_in, memory_gb, Reporter(blank.title or trial.title, step))
        write_atomically(folder / ARRAYS, lambda handle: np.savez_compressed(handle, **arrays))
    except MemoryError:
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno in DISK:
            raise
        text = " ".join(str(error).split()) or type(error).__name__
        if not isinstance(error, EXPECTED):
            text = f"{type(error).__name__}: {text} ({place_of(error)})"
            (folder / TRACEBACK).write_text(traceback.format_exc())
        status = ABSENT if isinstance(error, MissingData) else FAILED
        outcome = replace(blank, status=status, error=text[:2000])
    seconds, cpu_seconds = round(time.perf_counter() - start, 4), round(time.process_time() - cpu, 4)
    write_record(folder, replace(outcome, seconds=seconds, cpu_seconds=cpu_seconds, peak_mb=round(peak_mb(), 1)))


def compute(
    trial: Trial,
    blank: Outcome,
    data: Path,
    stand_in: bool,
    memory_gb: float = float("inf"),
    progress: Progress | None = None,
) -> tuple[Outcome, Mapping[str, Any]]:
    """Make the scene, run the method and measure; returns an Outcome of status ok and the arrays to keep.

    Raises DatasetError if the data are no longer those of the digest in ``blank``, and MethodError if the method
    foresees that it needs more than ``memory_gb``.
    """
    stage(progress, "scene")
    scene = load_scene(trial.dataset, data, stand_in)
    identified = blank.environment.get("data", "")
    if identified and digest(trial.dataset, data, stand_in) != identified:  # asked after loading, to leave no gap
        raise DatasetError(f"the data of {trial.dataset['name']} changed after this run began; start it again")
    n_bodies = _n_bodies(trial, scene)
    repeat = trial.noise["repeat"]
    noisy = scene.with_noise(trial.noise["level"], repeat)
    if trial.corruption:
        noisy = noisy.with_corruption(repeat, **trial.corruption)
    if trial.gaps:
        noisy = noisy.with_gaps(**trial.gaps, repeat=repeat)
    method = build_method({k: v for k, v in trial.method.items() if k != "name"})
    known = trial.cameras["source"] == "known"
    solution = reconstruct(
        noisy, method, n_bodies, trial.cameras, trial.observations or AS_GIVEN, memory_gb=memory_gb, progress=progress
    )
    stage(progress, "metrics")
    auto = n_bodies is None
    if auto and solution.labels is not None:
        n_bodies = len(np.unique(solution.labels))
    numbers = metrics.evaluate(noisy, solution, known_cameras=known, counted=auto)
    outcome = replace(blank, status=OK, metrics=numbers, stand_in=scene.stand_in, n_bodies=n_bodies)
    outcome = replace(outcome, n_points=scene.n_points, n_frames=scene.n_frames)
    parts = {name: getattr(solution, name) for name in ("structure", "labels", "affinity", "cameras")}
    parts |= {"tracks": noisy.tracks, "visible": noisy.visible}
    parts |= {"true_structure": scene.structure, "true_labels": scene.labels, "edges": scene.edges}
    if solution.cleaned is not None:
        parts |= {"scales": solution.cleaned.scales, "outliers": solution.cleaned.outliers}
    parts |= metrics.by_frame(noisy, solution, known_cameras=known)
    return outcome, pack(parts) | {f"history_{name}": values for name, values in solution.history.items()}


def _n_bodies(trial: Trial, scene: Scene) -> int | None:
    """The number of bodies that is passed to the method; None when it is to be estimated."""
    if trial.n_bodies == AUTO:
        return None
    n_bodies = trial.n_bodies or scene.n_bodies
    if not isinstance(n_bodies, int):
        raise UsageError(f"scene {scene.name} does not say how many bodies it has; set n_bodies, or n_bodies=auto")
    if scene.n_bodies is not None and n_bodies != scene.n_bodies:
        its = f"{scene.n_bodies} {'body' if scene.n_bodies == 1 else 'bodies'}"
        remedy = "leave n_bodies out or choose another scene"
        raise UsageError(f"scene {scene.name} has {its} and n_bodies is {n_bodies}; {remedy}")
    return n_bodies
