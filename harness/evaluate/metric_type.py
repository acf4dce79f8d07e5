"""What a metric is: a name, the function that computes it, and everything that tables and documents say of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeVar

import numpy as np

from nrsfm.datasets.body import centre
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.alignment import align_polar, align_procrustes
from nrsfm.harness.evaluate.trust import Trust, trust
from nrsfm.methods.base import Array, Labels, Reconstruction

T = TypeVar("T")

NO_STRUCTURE = "no structure to compare"
NO_CAMERAS = "no structure to compare, or no cameras"
NO_LABELS = "no labels to compare"


class Absent(Exception):
    """A metric does not apply: the scene or the reconstruction lacks a part that it needs."""


def needed(part: T | None) -> T:
    """The part itself; raises :class:`Absent` where it is None."""
    if part is None:
        raise Absent
    return part


@dataclass(frozen=True)
class Estimate:
    """A reconstruction beside the truth of its scene. Reading a part that is not there raises :class:`Absent`."""

    scene: Scene
    found: Reconstruction
    known_cameras: bool
    """Whether the method was given the true cameras. Then structures are compared as they are; otherwise after one
    orthogonal matrix for the whole sequence."""

    @cached_property
    def truth(self) -> Array:
        """(F, 3, P) true structure, centred per frame; NaN where a point is not known."""
        return centre(needed(self.scene.structure))

    @cached_property
    def structure(self) -> Array:
        """(F, 3, P) estimated structure, NaN where :attr:`truth` is, centred per frame."""
        return centre(np.where(np.isnan(self.truth), np.nan, needed(self.found.structure)))

    @cached_property
    def trust(self) -> Trust | None:
        """How far the structure can be trusted, which needs no truth; None without a structure or cameras."""
        return trust(self.scene, self.found, known_cameras=self.known_cameras)

    @cached_property
    def aligned(self) -> Array:
        """:attr:`structure` after :meth:`align`."""
        return self.align(self.structure, self.truth)

    @property
    def labels(self) -> Labels:
        """(P,) estimated labels."""
        return needed(self.found.labels)

    @property
    def true_labels(self) -> Labels:
        """(P,)."""
        return needed(self.scene.labels)

    def align(self, estimate: Array, truth: Array) -> Array:
        """The estimate after the Procrustes solution; as it is with known cameras."""
        return estimate if self.known_cameras else align_procrustes(estimate, truth)

    def align_polar(self, estimate: Array, truth: Array) -> Array:
        """The estimate after the polar rule of e_3d_dai's released code; as it is with known cameras."""
        return estimate if self.known_cameras else align_polar(estimate, truth)


@dataclass(frozen=True)
class Metric:
    """One logged number."""

    name: str  #: as it is logged
    of: Callable[[Estimate], float | Mapping[int, float]]
    """Computes it: a number, or body -> number for a metric of each body, which is logged as ``NAME_BODY``.

    Raises :class:`Absent` where the metric does not apply.
    """
    definition: str  #: one phrase of Markdown, for the table of metrics
    label: str = ""  #: for readers; the name by default
    tex: str = ""  #: as LaTeX; the label by default
    unit: str = "relative"
    """``relative`` to the size of the truth, ``share`` of a whole, a count of ``tracks`` or ``bodies``, or ""."""
    better: Literal["lower", "higher", ""] = "lower"  #: "" for a description, of which no number is better
    absent: str = NO_STRUCTURE  #: why a finished run may lack it
    counted: bool = False  #: logged only where the number of bodies was left to the method
    tolerance: float = 0.1
    """How far from a published number still counts as reproduced: in tracks where :attr:`counts` is set, otherwise as
    a share of the published number."""
    pool: str = "mean"  #: what a row that stands for many datasets shows by default: their ``mean`` or ``median``
    pooled_tolerance: float = 0.2  #: the tolerance of a pooled share, in percentage points
    counts: str = ""  #: for a share of tracks, the metric that counts them; verdicts are taken in tracks
    beside: str = ""  #: a second metric that tables print next to it
    remark: str = ""  #: a note under every table that has it with :attr:`beside`
    brief: str = ""  #: format of (value, number of tracks) for a line of progress; "" leaves it out
    summary: str = ""
    """Format for the summary of a solution, of all its metrics by name, ``n_points``, ``rms`` and ``aligned``."""

    def values(self, estimate: Estimate) -> dict[str, float]:
        """Logged name -> number; empty where the metric does not apply or is not finite."""
        try:
            value = self.of(estimate)
        except Absent:
            return {}
        values = {f"{self.name}_{k}": v for k, v in value.items()} if isinstance(value, Mapping) else {self.name: value}
        return {name: float(v) for name, v in values.items() if np.isfinite(v)}
