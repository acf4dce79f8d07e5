"""Solve tracks from Python: :func:`load` a file, :func:`solve` it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from nrsfm.datasets.readers.trackfile import Asked
from nrsfm.datasets.real.tracks import load_tracks
from nrsfm.datasets.scene import Scene
from nrsfm.harness.config.compose import compose_config
from nrsfm.harness.config.jobs import resolved
from nrsfm.harness.config.settings import read_plain
from nrsfm.harness.evaluate.reconstruct import reconstruct
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.trial import AUTO
from nrsfm.harness.solving.solution import FROM_FILE, NO_CAMERAS, Solution
from nrsfm.methods.base import Method, Progress
from nrsfm.methods.registry import build_method

CAMERAS = (AUTO, "known", "estimated", "refined")


def load(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    axes: str = "",
    confidence: float | None = None,
    y: str = AUTO,
) -> Scene:
    """Read tracks from a file or a folder of .json files: see :func:`nrsfm.datasets.real.tracks.load_tracks`.

    Parameters
    ----------
    path : path
    columns, axes, confidence, y
        How the file is to be read, where that is not to be recognised: see
        :class:`nrsfm.datasets.readers.trackfile.Asked`.

    Raises
    ------
    DatasetError
        If the file cannot be used.
    """
    return load_tracks(Path(path).expanduser(), asked=Asked(columns or {}, axes, confidence, y))


def solve(
    scene: Scene | str | Path,
    n_bodies: int | str | None = None,
    *,
    method: str | Method = "adaptive",
    cameras: str = AUTO,
    rank: int | None = None,
    overrides: Sequence[str] = (),
    progress: Progress | None = None,
    **settings: Any,
) -> Solution:
    """Reconstruct tracks and tell the bodies apart.

    Parameters
    ----------
    scene : Scene or path
        A scene, such as :func:`load` returns, or a file of tracks.
    n_bodies : int, "auto" or None
        Number of bodies; ``auto`` leaves it to the method, which is often wrong. None takes the number of the scene's
        labels.
    method : str or Method
        A name of ``nrsfm list methods``, or an instance of any method.
    cameras : {"auto", "known", "estimated", "refined"}
        ``auto`` takes the scene's cameras where it has them, and otherwise estimates them from the tracks. ``refined``
        refines the estimate, for cameras that turn smoothly.
    rank : int, optional
        K, the number of basis shapes for the estimation of cameras; see ``conf/cameras/estimated.yaml``.
    overrides : sequence of str
        As in the shell: ``method.max_iter=200``, ``cameras.refine=false``, ``limits.memory_gb=16``, ``threads=2``;
        ``observations.robust=false`` and ``observations.scale=false`` leave outliers and zoom in the tracks.
    progress : callable, optional
        Called after every iteration, see :data:`nrsfm.methods.base.Progress`. Its method ``stage``, if it has one, is
        called with the name of each stage.
    **settings
        The method's hyper-parameters.

    Raises
    ------
    DatasetError
        If a file cannot be used.
    MethodError
        If the method cannot solve the scene, or fails.
    UsageError
        If an argument cannot be used.
    """
    scene = scene if isinstance(scene, Scene) else load(scene)
    n_bodies = _n_bodies(n_bodies, scene)
    if cameras not in CAMERAS:
        raise UsageError(f"cameras is {cameras!r}, wanted one of {', '.join(CAMERAS)}")
    known = cameras == "known" or (cameras == AUTO and scene.cameras is not None)
    if known and scene.cameras is None:
        raise UsageError("there are no cameras in the file; leave 'known' out to have them estimated")
    source = "known" if known else "refined" if cameras == "refined" else "estimated"
    words = [f"cameras={source}", "observations=cleaned", *overrides]
    if rank is not None and not known:
        words.append(f"cameras.rank={rank}")
    if isinstance(method, str):
        words.insert(0, f"method={method}")
    config = resolved(compose_config(words))
    read_plain(config)  # raises if a value cannot be used
    if isinstance(method, str):
        parameters = _merged({k: v for k, v in config["method"].items() if k != "name"}, settings)
        solver, name = build_method(parameters), str(config["method"]["name"])
    else:
        solver, name = method.set_params(**settings) if settings else method, type(method).__name__
        parameters = method.get_params()
    start = time.perf_counter()
    with threadpool_limits(int(config["threads"])):  # more threads are slower on small arrays
        limit = float(config["limits"]["memory_gb"])
        found = reconstruct(
            scene, solver, n_bodies, config["cameras"], config["observations"], memory_gb=limit, progress=progress
        )
    estimated = f"the tracks, K = {config['cameras'].get('rank')}{', refined' * (source == 'refined')}"
    origin = FROM_FILE if known else estimated
    return Solution(
        scene=scene,
        found=found if solver.uses_cameras else replace(found, cameras=None),
        method=name,
        parameters=parameters,
        cameras_from=origin if solver.uses_cameras else NO_CAMERAS,
        counted=n_bodies is None,
        seconds=time.perf_counter() - start,
    )


def _n_bodies(n_bodies: object, scene: Scene) -> int | None:
    if n_bodies is None:
        if scene.n_bodies is None:
            raise UsageError("how many bodies are there? Set n_bodies (--bodies 2), or auto to have them counted")
        return scene.n_bodies
    if n_bodies == AUTO:
        return None
    if isinstance(n_bodies, bool) or not isinstance(n_bodies, int) or not 1 <= n_bodies <= scene.n_points:
        wanted = f"auto or a whole number from 1 to the {scene.n_points} tracks"
        raise UsageError(f"n_bodies is {n_bodies!r}, wanted {wanted}")
    return n_bodies


def _merged(settings: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Settings updated with others; the parts of a pipeline are updated within."""
    parts = {
        n: _merged(settings[n], v)
        for n, v in more.items()
        if isinstance(v, Mapping) and isinstance(settings.get(n), Mapping)
    }
    return {**settings, **more, **parts}
