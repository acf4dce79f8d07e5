"""A solution: what a method found in tracks, its errors where the truth is known, and its files."""

from __future__ import annotations

import json
import tempfile
import webbrowser
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy.sparse as sp
from numpy.typing import NDArray

from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.matching import matched, readable
from nrsfm.harness.evaluate.metric_type import Estimate
from nrsfm.harness.evaluate.metrics import METRICS, by_frame, values_of
from nrsfm.harness.evaluate.reprojection import reprojection_rms
from nrsfm.harness.evaluate.trust import Trust
from nrsfm.harness.record.environment import environment
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import pack
from nrsfm.harness.solving import cleaning, export, folder
from nrsfm.harness.solving.convergence import Convergence
from nrsfm.methods.base import Array, Labels, Mask, Reconstruction
from nrsfm.reports.figures.skeleton import stable_edges
from nrsfm.reports.page.solution_page import Shown, view

NO_CAMERAS, FROM_FILE = "no cameras", "the file"

#: Curves of a method's history that are no residuals: the objective, and the cost of each iteration.
NO_RESIDUAL = frozenset({"seconds", "operations", "objective"})

UNSURE = "counted by the method, which is often wrong: give the number if you know it"


@dataclass(frozen=True)
class Solution:
    """What a method with some parameters ``found`` in a scene's tracks. ``print`` shows its :meth:`facts`.

    ``cameras_from`` is ``the file``, ``the tracks, K = 11``, or ``no cameras``. ``counted`` says whether the method had
    to estimate the number of bodies.
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

    @property
    def scales(self) -> Array | None:
        """(F,) scale of each frame that was taken out of the tracks; None where it was not looked for."""
        return None if self.found.cleaned is None else self.found.cleaned.scales

    @property
    def outliers(self) -> Mask | None:
        """(F, P) observations that were taken for missing; None where outliers were not looked for."""
        return None if self.found.cleaned is None else self.found.cleaned.outliers

    @cached_property
    def labels(self) -> Labels | None:
        """(P,) body of each track, an index into :attr:`bodies`; None if the method gives none.

        Where true labels are known, each cluster takes the number of the body that it matches best; otherwise clusters
        are numbered in the order of the tracks.
        """
        labels = self.found.labels
        if labels is None or self.scene.labels is not None:
            return None if labels is None else matched(labels, self.scene.labels)
        return np.asarray(pd.factorize(labels)[0], dtype=np.int64)

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies: those of the true labels, ``body 1`` and so on where there are none."""
        n = 0 if self.labels is None else int(self.labels.max()) + 1
        names = self.scene.bodies if self.scene.labels is not None else ()
        return tuple(names[k] if k < len(names) else f"body {k + 1}" for k in range(n))

    @property
    def known_cameras(self) -> bool:
        return self.cameras_from == FROM_FILE

    @cached_property
    def _estimate(self) -> Estimate:
        return Estimate(self.scene, self.found, self.known_cameras)

    @cached_property
    def metrics(self) -> dict[str, float]:
        """Errors against the truth, as far as it is known: see :func:`nrsfm.harness.evaluate.metrics.evaluate`."""
        return values_of(self._estimate, counted=self.counted)

    @property
    def trust(self) -> Trust | None:
        """How far the structure can be trusted; None if the method gives none, or uses no cameras."""
        return self._estimate.trust

    @property
    def convergence(self) -> Convergence | None:
        """How the method's iteration ended; None where it records no residuals."""
        last = {name: values[-1] for name, values in self.found.history.items() if name not in NO_RESIDUAL}
        if not last:
            return None
        n = max(len(self.found.history[name]) for name in last)
        tolerance = self.parameters.get("tol")
        return Convergence(n, float(max(last.values())), tolerance if isinstance(tolerance, int | float) else None)

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the tracks; their places where the file names none."""
        return self.scene.track_ids or tuple(map(str, range(self.scene.n_points)))

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames; their places where the file names none."""
        return self.scene.frame_ids or tuple(map(str, range(self.scene.n_frames)))

    @cached_property
    def edges(self) -> NDArray[np.int64] | None:
        """(E, 2) pairs of tracks to draw lines between: the file's, or those that keep their distance."""
        if self.scene.edges is not None or self.structure is None:
            return self.scene.edges
        return stable_edges(self.structure, self.labels)

    @cached_property
    def _outliers(self) -> list[dict[str, Any]]:
        return cleaning.outlier_rows(self.scene, self.found, self.frames, self.ids)

    def facts(self) -> list[tuple[str, str]]:
        """Name and text of each line of the summary: sizes, method, bodies, errors, convergence, time."""
        scene = self.scene
        gaps = 0.0 if scene.visible is None else 1 - float(scene.visible.mean())
        return [
            *([("trust", str(self.trust))] if self.trust else []),
            ("frames", str(scene.n_frames)),
            ("tracks", f"{scene.n_points}, {f'{gaps:.1%}' if gaps else 'none'} of the observations missing"),
            *(("note", note) for note in scene.notes),
            *(cleaning.told(self.found.cleaned) if self.found.cleaned else []),
            ("method", self.method),
            ("cameras", f"from {self.cameras_from}" if self.cameras_from != NO_CAMERAS else "not used"),
            *self._bodies_and_metrics(),
            ("convergence", str(self.convergence or "the method records no iterations")),
            ("time", f"{self.seconds:.1f} s"),
        ]

    def _bodies_and_metrics(self) -> Iterator[tuple[str, str]]:
        if self.labels is not None:
            counts = zip(self.bodies, np.bincount(self.labels).tolist(), strict=True)
            sizes = ", ".join(f"{readable(name)}: {n} tracks" for name, n in counts if n)
            yield "bodies", f"{len(np.unique(self.labels))} ({sizes}){f'; {UNSURE}' if self.counted else ''}"
        aligned = "" if self.known_cameras else ", after one rotation for all frames"
        rms = reprojection_rms(self.scene, self.found)
        values = {**self.metrics, "n_points": self.scene.n_points, "rms": rms, "aligned": aligned}
        for metric in METRICS:
            if metric.summary and metric.name in values:
                yield metric.label or metric.name, metric.summary.format(**values)

    def __str__(self) -> str:
        return "\n".join(f"{name:<13} {text}" for name, text in [("tracks of", self.scene.name), *self.facts()])

    def save(self, path: str | Path) -> Path:
        """Write everything into a folder; an earlier solution there is replaced once all of it is written.

        ``reconstruction.npz`` (``structure`` (F, 3, P), ``labels`` (P,), ``cameras`` (F, 2, 3), ``affinity`` (P, P) or,
        where it is sparse, the rows, columns and values of its upper triangle; ``frame_ids``, ``track_ids``,
        ``bodies``), ``structure.csv``, ``labels.csv``, ``cameras.csv``, ``affinity.csv``, ``ply/frame_0000.ply`` and so
        on, ``outliers.csv``, ``view.html``, ``summary.txt``, ``result.json``. Absent parts are
        left out.

        Returns the folder; raises UsageError if it holds anything else than a solution.
        """
        path = Path(path).expanduser().resolve()
        folder.check_folder(path)
        with folder.replaced(path) as new:
            self._write_arrays(new / folder.ARRAYS)
            self._write_tables(new)
            if self.structure is not None:
                export.write_clouds(new / folder.CLOUDS, self.structure, self.labels)
            (new / folder.VIEW).write_text(self.page(), encoding="utf-8")
            (new / folder.SUMMARY).write_text(f"{self}\n", encoding="utf-8")
            (new / folder.RESULT).write_text(self._record(), encoding="utf-8")
        return path

    def animate(self, path: str | Path) -> None:
        """Write a GIF: the tracks in the image beside the bodies in 3D, turning.

        Raises
        ------
        UsageError
            If the method gives no structure.
        """
        from nrsfm.reports.figures.animation import animate

        if self.structure is None:
            raise UsageError(f"{self.method} gives no structure, so there is nothing to animate; choose another method")
        animate(Path(path), self.scene.tracks, self.structure, self.labels, self.edges)

    def show(self) -> Path:
        """Open the 3D view in a browser; returns the path of the page, which is in a temporary folder."""
        path = Path(tempfile.mkdtemp(prefix="nrsfm-")) / folder.VIEW
        path.write_text(self.page(), encoding="utf-8")
        webbrowser.open(path.as_uri())
        return path

    def page(self) -> str:
        """The 3D view as HTML, in the axes of the truth where that is known."""
        scene, S, truth, wrong = self.scene, self.structure, None, None
        frames = by_frame(scene, self.found, known_cameras=self.known_cameras)
        if S is not None and scene.structure is not None:
            S, truth = frames["alignment"] @ S, scene.structure
        if self.labels is not None and scene.labels is not None:
            wrong = np.asarray(self.labels != scene.labels)
        return view(
            Shown(
                title=scene.name,
                facts=self.facts(),
                ids=self.ids,
                frames=self.frames,
                structure=S,
                truth=truth,
                cameras=scene.cameras if truth is not None else self.cameras,
                labels=self.labels,
                bodies=[readable(body) for body in self.bodies],
                wrong=wrong,
                edges=self.edges,
                affinity=self.affinity,
                history=self.found.history,
                errors=frames.get("frame_e_3d"),
            )
        )

    def _write_arrays(self, path: Path) -> None:
        parts = {name: getattr(self, name) for name in ("structure", "labels", "cameras", "affinity")}
        parts |= {
            "scales": self.scales,
            "outliers": self.outliers,
            "visible": self.scene.visible,
            "edges": self.edges,
            "frame_ids": np.array(self.frames),
        }
        parts |= {"expected_error": self.trust.tracks if self.trust else None}
        parts |= {"track_ids": np.array(self.ids), "bodies": np.array(self.bodies, dtype=str)}
        arrays: dict[str, Any] = pack(parts)
        np.savez_compressed(path, **arrays)

    def _write_tables(self, new: Path) -> None:
        bodies = None if self.labels is None else [self.bodies[k] for k in self.labels.tolist()]
        if self.structure is not None:
            export.write_structure(new / folder.STRUCTURE, self.structure, self.frames, self.ids, bodies)
        if bodies is not None:
            columns: dict[str, Any] = {"track": self.ids, "label": bodies}
            if (truth := self.scene.labels) is not None:
                names = self.scene.bodies
                columns["true_label"] = [names[k] if names else str(k) for k in truth.tolist()]
            export.write_csv(new / folder.LABELS, columns)
        if self.cameras is not None:
            entries = zip(("xx", "xy", "xz", "yx", "yy", "yz"), self.cameras.reshape(-1, 6).T, strict=True)
            scale = {} if self.scales is None else {"scale": self.scales}
            export.write_csv(new / folder.CAMERAS, {"frame": self.frames, **dict(entries), **scale})
        if self.outliers is not None:
            columns = {name: [row[name] for row in self._outliers] for name in ("frame", "track", "residual")}
            export.write_csv(new / folder.OUTLIERS, columns, "%.6g")
        if self.affinity is not None:
            export.write_affinity(new / folder.AFFINITY, self.affinity, self.ids)

    def _record(self) -> str:
        end = self.convergence
        record = {
            "made_by": folder.MADE_BY,
            "name": self.scene.name,
            "data": self.scene.digest,
            "method": self.method,
            "parameters": self.parameters,
            "cameras": self.cameras_from,
            **({"trust": self.trust.record} if self.trust else {}),
            "facts": self.facts(),
            **({} if self.scales is None else {"scales": self.scales.tolist()}),
            **({} if self.outliers is None else {"outliers": self._outliers}),
            "metrics": self.metrics,
            "seconds": self.seconds,
            **({"iterations": end.iterations, "residual": end.residual, "tolerance_met": end.met} if end else {}),
            "environment": environment(),
        }
        return json.dumps(record, indent=1, default=str) + "\n"
