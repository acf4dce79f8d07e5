"""What a metric is: a name, the function that computes it, and everything that tables and documents say of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import centre
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.alignment import align_polar, align_procrustes
from nrsfm.methods.base import Array, Labels, Reconstruction

T = TypeVar("T")

NO_STRUCTURE = "method gives no structure"
NO_LABELS = "method gives no labels"


class Absent(Exception):
    """A metric does not apply: the scene or the reconstruction lacks a part that it needs."""


def needed(part: T | None) -> T:
    """The part itself; raises :class:`Absent` where it is None."""
    if part is None:
        raise Absent
    return part


@dataclass(frozen=True)
class Estimate:
    """A reconstruction beside the truth of its scene. Reading a part that is not there raises :class:`Absent`.

    Parameters
    ----------
    scene : Scene
    found : Reconstruction
    known_cameras : bool
        Whether the method was given the true cameras. Then structures are compared as they are; otherwise after one
        orthogonal matrix for the whole sequence.
    """

    scene: Scene
    found: Reconstruction
    known_cameras: bool

    @cached_property
    def truth(self) -> Array:
        """(F, 3, P) true structure, centred per frame; NaN where a point is not known."""
        return centre(needed(self.scene.structure))

    @cached_property
    def structure(self) -> Array:
        """(F, 3, P) estimated structure, NaN where :attr:`truth` is, centred per frame."""
        return centre(np.where(np.isnan(self.truth), np.nan, needed(self.found.structure)))

    @cached_property
    def aligned(self) -> Array:
        """:attr:`structure` after :meth:`align`."""
        return self.align(self.structure, self.truth)

    @property
    def cameras(self) -> Array:
        """(F, 2, 3) cameras that the structure was made with."""
        return needed(self.found.cameras)

    @property
    def true_cameras(self) -> Array:
        """(F, 2, 3)."""
        return needed(self.scene.cameras)

    @property
    def labels(self) -> Labels:
        """(P,) estimated labels."""
        return needed(self.found.labels)

    @property
    def true_labels(self) -> Labels:
        """(P,)."""
        return needed(self.scene.labels)

    @property
    def visible(self) -> NDArray[np.bool_]:
        """(F, P); absent where every track was observed in every frame."""
        return needed(self.scene.visible)

    def align(self, estimate: Array, truth: Array) -> Array:
        """The estimate after the Procrustes solution; as it is with known cameras."""
        return estimate if self.known_cameras else align_procrustes(estimate, truth)

    def align_polar(self, estimate: Array, truth: Array) -> Array:
        """The estimate after the polar rule of e_3d_dai's released code; as it is with known cameras."""
        return estimate if self.known_cameras else align_polar(estimate, truth)


@dataclass(frozen=True)
class Metric:
    """One logged number.

    Parameters
    ----------
    name : str
        As it is logged.
    of : callable
        Computes it from an :class:`Estimate`: a number, or body -> number for a metric of each body, which is logged
        as ``NAME_BODY``. Raises :class:`Absent` where the metric does not apply.
    definition : str
        One phrase of Markdown, for the table of metrics.
    label, tex : str
        For readers, and as LaTeX; the name and the label by default.
    unit : str
        ``relative`` to the size of the truth, ``share`` of a whole, a count of ``tracks`` or ``bodies``, or "".
    better : {"lower", "higher", ""}
        Which numbers are better; "" for a description, of which none is.
    absent : str
        Why a finished run may lack it.
    counted : bool
        Logged only where the number of bodies was left to the method.
    tolerance : float
        How far from a published number still counts as reproduced: in tracks where :attr:`counts` is set, otherwise
        as a share of the published number.
    pool : str
        What a row that stands for many datasets shows by default: their ``mean`` or ``median``.
    pooled_tolerance : float
        The tolerance of a pooled share, in percentage points.
    counts : str
        For a share of tracks, the metric that counts them; verdicts are taken in tracks.
    beside : str
        A second metric that tables print next to it.
    remark : str
        A note under every table that has it with :attr:`beside`.
    brief : str
        Format of (value, number of tracks) for a line of progress; "" leaves it out.
    summary : str
        Format for the summary of a solution, of all its metrics by name, ``n_points``, ``rms`` and ``aligned``.
    """

    name: str
    of: Callable[[Estimate], float | Mapping[int, float]]
    definition: str
    label: str = ""
    tex: str = ""
    unit: str = "relative"
    better: Literal["lower", "higher", ""] = "lower"
    absent: str = NO_STRUCTURE
    counted: bool = False
    tolerance: float = 0.1
    pool: str = "mean"
    pooled_tolerance: float = 0.2
    counts: str = ""
    beside: str = ""
    remark: str = ""
    brief: str = ""
    summary: str = ""

    def values(self, estimate: Estimate) -> dict[str, float]:
        """Logged name -> number; empty where the metric does not apply or is not finite."""
        try:
            value = self.of(estimate)
        except Absent:
            return {}
        values = {f"{self.name}_{k}": v for k, v in value.items()} if isinstance(value, Mapping) else {self.name: value}
        return {name: float(v) for name, v in values.items() if np.isfinite(v)}
