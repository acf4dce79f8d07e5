"""The inside of a trial: scene, method, metrics, and the files it leaves. Runs in a process of its own."""

from __future__ import annotations

import time
import traceback
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from datasets.body import DatasetError
from datasets.registry import load_scene
from datasets.scene import Scene
from harness import metrics
from harness.isolation import peak_mb
from harness.memory import Size, refusal
from harness.record import FAILED, OK, Outcome, Trial, UsageError
from harness.running import Reporter
from harness.storage import ARRAYS, TRACEBACK, pack, write_atomically, write_record
from methods.base import NO_CAMERAS, Array, MethodError, Progress, Reconstruction
from methods.registry import build_method
from methods.rotation import estimate_cameras

EXPECTED = (DatasetError, MethodError, UsageError)


def work(
    trial: Trial,
    blank: Outcome,
    data: Path,
    stand_in: bool,
    folder: Path,
    memory_gb: float = float("inf"),
    running: Path | None = None,
) -> None:
    """Carry out a trial and leave its record in ``folder``; an exception becomes a record of status failed.

    Meanwhile ``running`` is told how far it is. What does not fit into ``memory_gb`` is not begun.
    """
    start = time.perf_counter()
    try:
        outcome, arrays = compute(trial, blank, data, stand_in, memory_gb, Reporter(trial.title, running))
        write_atomically(folder / ARRAYS, lambda handle: np.savez_compressed(handle, **arrays))
    except MemoryError:
        raise
    except Exception as error:
        text = " ".join(str(error).split()) or type(error).__name__
        if not isinstance(error, EXPECTED):
            text = f"{type(error).__name__}: {text}"
            (folder / TRACEBACK).write_text(traceback.format_exc())
        outcome = replace(blank, status=FAILED, error=text[:2000])
    outcome = replace(outcome, seconds=round(time.perf_counter() - start, 4), peak_mb=round(peak_mb(), 1))
    write_record(folder, outcome)


def compute(
    trial: Trial,
    blank: Outcome,
    data: Path,
    stand_in: bool,
    memory_gb: float = float("inf"),
    progress: Progress | None = None,
) -> tuple[Outcome, Mapping[str, Any]]:
    """The trial itself: an Outcome of status ok and the arrays to keep.

    Raises
    ------
    DatasetError, MethodError, UsageError
        If the scene or the method cannot be had as asked, or the method would need more memory than it may take.
    """
    scene = load_scene(trial.dataset, data, stand_in)
    n_bodies = trial.n_bodies or scene.n_bodies
    if n_bodies is None:
        raise UsageError(f"scene {scene.name} does not say how many bodies it has; set n_bodies")
    if scene.n_bodies is not None and n_bodies != scene.n_bodies:
        raise UsageError(
            f"scene {scene.name} has {scene.n_bodies} {'body' if scene.n_bodies == 1 else 'bodies'} and n_bodies is "
            f"{n_bodies}; leave n_bodies out or choose another scene"
        )
    noisy = scene.with_noise(trial.noise["level"], trial.noise["repeat"])
    method = build_method({k: v for k, v in trial.method.items() if k != "name"})
    if why := refusal(method, Size.of(scene), memory_gb):
        raise UsageError(why)
    known = trial.cameras["source"] == "known"
    cameras = _cameras(noisy, trial) if method.uses_cameras else NO_CAMERAS
    found = method.reconstruct(noisy.tracks, cameras, n_bodies, edges=scene.edges, progress=progress)
    check(found, method.provides, noisy.tracks.shape)
    outcome = replace(
        blank,
        status=OK,
        metrics=metrics.evaluate(noisy, found, known_cameras=known),
        stand_in=scene.stand_in,
        n_bodies=n_bodies,
        n_points=scene.n_points,
        n_frames=scene.n_frames,
    )
    parts = {
        "structure": found.structure,
        "labels": found.labels,
        "affinity": found.affinity,
        "cameras": found.cameras,
        "tracks": noisy.tracks,
        "true_structure": scene.structure,
        "true_labels": scene.labels,
        "edges": scene.edges,
    }
    arrays = pack({name: value for name, value in parts.items() if value is not None})
    return outcome, arrays | {f"history_{name}": values for name, values in found.history.items()}


def _cameras(scene: Scene, trial: Trial) -> Array:
    if trial.cameras["source"] != "known":
        options = {name: trial.cameras[name] for name in ("rank", "start", "refine") if name in trial.cameras}
        return estimate_cameras(scene.tracks, **options)
    if scene.cameras is None:
        raise UsageError(f"scene {scene.name} has no cameras; use cameras=estimated")
    return scene.cameras


def check(found: Reconstruction, provides: frozenset[str], shape: tuple[int, ...]) -> None:
    """Hold a method to its word: raises MethodError on parts that are absent, misshapen or not finite."""
    n_frames, _, n_points = shape
    wanted = {"structure": (n_frames, 3, n_points), "labels": (n_points,), "affinity": (n_points, n_points)}
    for name, size in wanted.items():
        value = getattr(found, name)
        if value is None:
            if name in provides:
                raise MethodError(f"the method promises {name} and gave none")
        elif value.shape != size:
            raise MethodError(f"the method gave {name} of shape {value.shape}, wanted {size}")
        elif not np.isfinite(value.data if sp.issparse(value) else value).all():
            raise MethodError(f"the method gave {name} with NaN or infinite values: it diverged")
