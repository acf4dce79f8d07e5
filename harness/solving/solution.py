"""Tracks of one's own in Python: load them, solve them, look at what was found."""

from __future__ import annotations

import tempfile
import time
import webbrowser
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from threadpoolctl import threadpool_limits

from nrsfm.datasets.real.tracks import load_tracks
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate import metrics
from nrsfm.harness.evaluate.matching import called
from nrsfm.harness.evaluate.reconstruct import reconstruct
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.trial import AUTO
from nrsfm.methods.base import Array, Labels, Method, Progress, Reconstruction
from nrsfm.methods.registry import build_method

CAMERAS = (AUTO, "known", "estimated")


#: What an iteration took, and what it minimises: no residual.
NO_RESIDUAL = frozenset({"seconds", "operations", "objective"})


UNSURE = "counted by the method, which is seldom right: say the number where you know it"


@dataclass(frozen=True)
class Convergence:
    """How an iteration ended: after how many, its largest residual, and the tolerance, None for a method without."""

    iterations: int
    residual: float
    tolerance: float | None

    @property
    def met(self) -> bool:
        return self.tolerance is not None and self.residual < self.tolerance

    def __str__(self) -> str:
        words = f"{self.iterations} iterations, residual {self.residual:.2g}"
        if self.tolerance is None:
            return words
        return f"{words}, {'below' if self.met else 'NOT below'} the tolerance {self.tolerance:.2g}"


@dataclass(frozen=True)
class Solution:
    """What a method found in somebody's tracks. ``print`` says it in words.

    Parameters
    ----------
    scene : Scene
        What it was found in.
    found : Reconstruction
        As the method gave it.
    method : str
    parameters : mapping
        The method's settings.
    cameras_from : str
        ``the file``, ``the tracks, K = 11``, or ``no cameras``.
    counted : bool
        Whether the number of bodies was left to the method.
    seconds : float
        Wall time.
    """

    scene: Scene
    found: Reconstruction
    method: str
    parameters: Mapping[str, Any]
    cameras_from: str
    counted: bool
    seconds: float

    @property
    def structure(self) -> Array | None:
        """(F, 3, P) points in the units of the tracks, centred per frame; None if the method gives none."""
        return self.found.structure

    @property
    def cameras(self) -> Array | None:
        """(F, 2, 3) cameras that the structure was made with."""
        return self.found.cameras

    @property
    def affinity(self) -> Array | sp.sparray | None:
        """(P, P) affinity that was clustered."""
        return self.found.affinity

    @cached_property
    def labels(self) -> Labels | None:
        """(P,) body of each track, an index into :attr:`bodies`; None if the method gives none.

        With true labels the bodies are theirs, as they match best; otherwise they are numbered as tracks come.
        """
        found = self.found.labels
        if found is None:
            return None
        if self.scene.labels is not None:
            from nrsfm.harness.evaluate.matching import matched

            return np.asarray(matched(found, self.scene.labels), dtype=np.int64)
        _, first, place = np.unique(found, return_index=True, return_inverse=True)
        return np.argsort(np.argsort(first))[place.reshape(-1)]

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies: those of the true labels, ``body 1`` and so on where there are none."""
        n = 0 if self.labels is None else int(self.labels.max()) + 1
        names = self.scene.bodies if self.scene.labels is not None else ()
        return tuple(names[k] if k < len(names) else f"body {k + 1}" for k in range(n))

    @property
    def known_cameras(self) -> bool:
        return self.cameras_from == "the file"

    @cached_property
    def metrics(self) -> dict[str, float]:
        """Errors against the truth, as far as it is known: see :func:`nrsfm.harness.evaluate.metrics.evaluate`."""
        found = metrics.evaluate(self.scene, self.found, known_cameras=self.known_cameras)
        return found | (metrics.count(self.scene, self.found) if self.counted else {})

    @property
    def convergence(self) -> Convergence | None:
        """How the method's iteration ended, None where it tells nothing."""
        last = {name: values[-1] for name, values in self.found.history.items() if name not in NO_RESIDUAL}
        if not last:
            return None
        n = max(len(self.found.history[name]) for name in last)
        tolerance = self.parameters.get("tol")
        return Convergence(n, float(max(last.values())), tolerance if isinstance(tolerance, int | float) else None)

    @property
    def ids(self) -> tuple[str, ...]:
        """What the file calls its tracks; their places where it does not."""
        return self.scene.track_ids or tuple(map(str, range(self.scene.n_points)))

    @property
    def frames(self) -> tuple[str, ...]:
        """What the file calls its frames; their places where it does not."""
        return self.scene.frame_ids or tuple(map(str, range(self.scene.n_frames)))

    def facts(self) -> list[tuple[str, str]]:
        """What a person wants to know, name and words."""
        scene, m = self.scene, self.metrics
        gaps = 0.0 if scene.visible is None else 1 - float(scene.visible.mean())
        facts = [
            ("frames", str(scene.n_frames)),
            ("tracks", f"{scene.n_points}, {'none of' if not gaps else f'{gaps:.1%} of'} the observations missing"),
            *(("note", note) for note in scene.notes),
            ("method", self.method),
            ("cameras", f"from {self.cameras_from}" if self.cameras_from != "no cameras" else "not used"),
        ]
        if self.labels is not None:
            sizes = ", ".join(
                f"{called(name)}: {n} tracks"
                for name, n in zip(self.bodies, np.bincount(self.labels).tolist(), strict=True)
                if n
            )
            facts.append(
                ("bodies", f"{len(np.unique(self.labels))} ({sizes})" + (f"; {UNSURE}" if self.counted else ""))
            )
        if "reprojection" in m:
            rms = metrics.reprojection_rms(scene, self.found)
            facts.append(
                ("reprojection", f"{m['reprojection']:.3g} of the tracks' size, {rms:.3g} in their units (rms)")
            )
        facts.append(("convergence", str(self.convergence or "the method tells nothing of iterations")))
        facts.append(("time", f"{self.seconds:.1f} s"))
        if "e_3d" in m:
            aligned = "" if self.known_cameras else ", after one rotation for all frames"
            facts.append(("e_3D", f"{m['e_3d']:.4f} (in the older literature's units {m['e_3d_dai']:.4f}){aligned}"))
        if "e_ms" in m:
            facts.append(("e_MS", f"{m['e_ms']:.4f}, {m['n_wrong']:.0f} of {scene.n_points} tracks wrong"))
        if "e_r" in m:
            facts.append(("e_R", f"{m['e_r']:.4f}"))
        return facts

    def __str__(self) -> str:
        return "\n".join(f"{name:<13} {said}" for name, said in [("tracks of", self.scene.name), *self.facts()])

    def save(self, folder: str | Path) -> Path:
        """Write everything into a folder: see :func:`nrsfm.harness.solving.export.save`."""
        from nrsfm.harness.solving.export import save

        return save(self, Path(folder))

    def show(self) -> Path:
        """Open the 3D view in a browser; the page stands in a temporary folder, and its path is given back."""
        from nrsfm.harness.solving.export import page

        path = Path(tempfile.mkdtemp(prefix="nrsfm-")) / "view.html"
        path.write_text(page(self), encoding="utf-8")
        webbrowser.open(path.as_uri())
        return path


def load(path: str | Path) -> Scene:
    """Read tracks from .npz, .mat, .csv or .c3d: see :func:`nrsfm.datasets.real.tracks.load_tracks`."""
    return load_tracks(Path(path).expanduser())


def solve(
    scene: Scene | str | Path,
    n_bodies: int | str | None = None,
    *,
    method: str | Method = "ours",
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
        What :func:`load` gave, any other scene, or a file.
    n_bodies : int, "auto" or None
        How many bodies there are; ``auto`` leaves that to the method, which is seldom right. None takes the number of
        the scene's labels.
    method : str or Method
        Any of ``nrsfm list methods``, or a method of one's own.
    cameras : {"auto", "known", "estimated"}
        ``auto`` takes those of the scene where it has some, and else estimates them from the tracks.
    rank : int, optional
        K, the number of shapes that estimation allows; see ``conf/cameras/estimated.yaml``.
    overrides : sequence of str
        As in the shell: ``method.max_iter=200``, ``cameras.refine=false``, ``limits.memory_gb=16``, ``threads=2``.
    progress : callable, optional
        Told of every iteration, see :data:`nrsfm.methods.base.Progress`; of the stages, too, if it has a method ``stage``.
    **settings
        The method's hyper-parameters.

    Raises
    ------
    DatasetError
        If a file cannot be used.
    MethodError
        If the method cannot do what is asked, or fails.
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
    words = [f"cameras={'known' if known else 'estimated'}", *overrides]
    if rank is not None and not known:
        words.append(f"cameras.rank={rank}")
    if isinstance(method, str):
        words.insert(0, f"method={method}")
    asked = _configured(words)
    if isinstance(method, str):
        parameters = _merged({k: v for k, v in asked["method"].items() if k != "name"}, settings)
        made, name = build_method(parameters), str(asked["method"]["name"])
    else:
        made, name = method.set_params(**settings) if settings else method, type(method).__name__
        parameters = method.get_params()
    start = time.perf_counter()
    with threadpool_limits(int(asked["threads"])):  # more are slower on small arrays, and many times beside other work
        found = reconstruct(
            scene,
            made,
            n_bodies,
            asked["cameras"],
            memory_gb=float(asked["limits"]["memory_gb"]),
            progress=progress,
        )
    source = "the file" if known else f"the tracks, K = {asked['cameras'].get('rank')}"
    return Solution(
        scene=scene,
        found=found if made.uses_cameras else replace(found, cameras=None),
        method=name,
        parameters=parameters,
        cameras_from=source if made.uses_cameras else "no cameras",
        counted=n_bodies is None,
        seconds=time.perf_counter() - start,
    )


def _n_bodies(asked: object, scene: Scene) -> int | None:
    if asked is None:
        if scene.n_bodies is None:
            raise UsageError("how many bodies are there? Say n_bodies (--bodies 2), or auto to have them counted")
        return scene.n_bodies
    if asked == AUTO:
        return None
    if isinstance(asked, bool) or not isinstance(asked, int) or not 1 <= asked <= scene.n_points:
        raise UsageError(f"n_bodies is {asked!r}, wanted auto or a whole number from 1 to the {scene.n_points} tracks")
    return asked


def _configured(overrides: Sequence[str]) -> dict[str, Any]:
    """The configuration as plain data."""
    from nrsfm.harness.config.compose import compose_config
    from nrsfm.harness.config.jobs import resolved
    from nrsfm.harness.config.settings import read_plain

    plain = resolved(compose_config(overrides))
    read_plain(plain)
    return plain


def _merged(settings: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Settings with others in their places, parts of a pipeline within theirs."""
    return dict(settings) | {
        name: _merged(settings[name], value)
        if isinstance(value, Mapping) and isinstance(settings.get(name), Mapping)
        else value
        for name, value in more.items()
    }
