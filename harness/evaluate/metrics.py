"""Computes all metrics. :data:`METRICS` lists them, each with its function, its label and its definition.

Points count whether they were observed or not, where their true place is known; places that are NaN do not count.
A new metric is a function and an entry here: tables, documents and summaries read the entries.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from nrsfm.datasets.body import centre, observed
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.alignment import centre_bodies, procrustes
from nrsfm.harness.evaluate.errors import (
    affinity_between,
    e_3d,
    e_3d_centred,
    e_3d_dai,
    e_3d_procrustes,
    e_3d_total,
    e_r,
    frame_errors,
    n_wrong,
    norm,
)
from nrsfm.harness.evaluate.metric_type import NO_CAMERAS, NO_LABELS, NO_STRUCTURE, Absent, Estimate, Metric, needed
from nrsfm.harness.evaluate.reprojection import given, image_residuals
from nrsfm.methods.base import Array, Reconstruction
from nrsfm.methods.clustering.spectral import MOST, eigengaps
from nrsfm.methods.numerics.linear import axes


def evaluate(scene: Scene, found: Reconstruction, *, known_cameras: bool, counted: bool = False) -> dict[str, float]:
    """All metrics that the truth of the scene and the parts of the reconstruction allow, by logged name.

    They are in the order of :data:`METRICS`, those that do not apply left out; all values are finite.

    Parameters
    ----------
    known_cameras : bool
        Whether the method was given the true cameras; if not, structures are aligned first.
    counted : bool
        Whether the method had to estimate the number of bodies.
    """
    return values_of(Estimate(scene, found, known_cameras), counted=counted)


def values_of(estimate: Estimate, *, counted: bool = False) -> dict[str, float]:
    """:func:`evaluate` of an estimate that is there already."""
    return {
        name: value
        for metric in METRICS
        if counted or not metric.counted
        for name, value in metric.values(estimate).items()
    }


def by_frame(scene: Scene, found: Reconstruction, *, known_cameras: bool) -> dict[str, Array]:
    """``frame_e_3d`` (F,), whose mean is e_3d, and ``alignment`` (3, 3), the matrix that precedes it.

    Empty where there is no truth or no structure. With known cameras the alignment is the identity.
    """
    estimate = Estimate(scene, found, known_cameras)
    try:
        S, truth = estimate.structure, estimate.truth
    except Absent:
        return {}
    alignment = np.eye(3) if known_cameras else procrustes(S, truth)
    return {"frame_e_3d": frame_errors(alignment @ S, truth), "alignment": alignment}


def brief(values: Mapping[str, float], n_points: int | None) -> list[str]:
    """The main metrics for one line: ``["e_3d 0.0318", "wrong 0/116"]``."""
    return [m.brief.format(values[m.name], n_points) for m in METRICS if m.brief and m.name in values]


def _part(estimate: Estimate, visible: bool) -> float:
    """e_3d over the points that were observed, or over those that were not."""
    part = needed(estimate.scene.visible) == visible
    truth, aligned = estimate.truth, estimate.aligned
    if not (part & observed(truth)).any():
        raise Absent
    return e_3d(aligned, np.where(part[:, None], truth, np.nan))


def _in_camera_frame(estimate: Estimate) -> float:
    mine = axes(needed(estimate.found.cameras)) @ estimate.structure
    true = axes(needed(estimate.scene.cameras)) @ estimate.truth
    return e_3d_dai(estimate.align_polar(mine, true), true)


def _centred(estimate: Estimate) -> float:
    labels, truth = estimate.true_labels, estimate.truth
    centred = estimate.align(centre_bodies(estimate.structure, labels), centre_bodies(truth, labels))
    return e_3d_centred(centred, truth, labels)


def _by_body(estimate: Estimate) -> dict[int, float]:
    errors = {}
    for k in np.unique(estimate.true_labels).tolist():
        body = estimate.true_labels == k
        S, truth = (centre(X[:, :, body]) for X in (estimate.structure, estimate.truth))
        errors[k] = e_3d(estimate.align(S, truth), truth)
    return errors


def _reprojection(estimate: Estimate) -> float:
    tracks, found = given(estimate.scene, estimate.found).tracks, estimate.found
    return float(norm(image_residuals(tracks, needed(found.cameras), needed(found.structure))) / norm(centre(tracks)))


def _rotation(estimate: Estimate) -> float:
    needed(estimate.found.structure)
    if estimate.known_cameras:
        raise Absent
    return e_r(needed(estimate.found.cameras), needed(estimate.scene.cameras))


def _wrong(estimate: Estimate) -> int:
    return n_wrong(estimate.labels, estimate.true_labels)


def _clusters(estimate: Estimate) -> int:
    return len(np.unique(estimate.labels))


def _eigengap(estimate: Estimate) -> float:
    n, affinity = _clusters(estimate), needed(estimate.found.affinity)
    if n > MOST:
        raise Absent
    return float(eigengaps(affinity)[n - 1])


def _trusted(name: str, definition: str, label: str = "", unit: str = "relative") -> Metric:
    """A figure of :class:`nrsfm.harness.evaluate.trust.Trust`, which needs no truth."""

    def figure(estimate: Estimate) -> float:
        return needed(estimate.trust).figures[name]

    return Metric(name, figure, definition, label=label, unit=unit, better="", absent=NO_CAMERAS)


METRICS = (
    Metric(
        "e_3d",
        lambda e: e_3d(e.aligned, e.truth),
        "the paper's error, eq. (22): mean over frames of the error relative to the truth",
        label="e_3D",
        tex="$e_{3D}$",
        brief="e_3d {:.4f}",
        summary="{e_3d:.4f} (in the older literature's units {e_3d_dai:.4f}){aligned}",
    ),
    Metric(
        "e_3d_total",
        lambda e: e_3d_total(e.aligned, e.truth),
        "the ratio of `e_3d` over the whole sequence, not frame by frame",
    ),
    Metric(
        "e_3d_procrustes",
        lambda e: e_3d_procrustes(e.structure, e.truth),
        "`e_3d` after the best orthogonal matrix of each frame",
    ),
    Metric(
        "e_3d_dai",
        lambda e: e_3d_dai(e.align_polar(e.structure, e.truth), e.truth),
        "the older literature's error: mean distance over the mean standard deviation of the truth's rows",
        label="e_3D",
        tex="$e_{3D}$",
        beside="e_3d",
        remark="e_3D: the measured number is e_3d_dai, the older literature's error, which the published numbers "
        "follow; e_3d, the error of the paper's printed equation, stands next to it.",
        brief="e_3d_dai {:.4f}",
    ),
    Metric(
        "e_3d_visible",
        lambda e: _part(e, visible=True),
        "`e_3d` over the points that were observed",
        label="e_3D of visible points",
        absent=f"{NO_STRUCTURE}, or nothing is hidden",
    ),
    Metric(
        "e_3d_hidden",
        lambda e: _part(e, visible=False),
        "`e_3d` over the points that were not observed",
        label="e_3D of hidden points",
        tex="$e_{3D}$ of hidden points",
        absent=f"{NO_STRUCTURE}, or nothing is hidden",
    ),
    Metric(
        "e_3d_dai_cam",
        _in_camera_frame,
        "`e_3d_dai` in the camera's frame",
        label="e_3D, camera frame",
        tex="$e_{3D}$, camera frame",
    ),
    Metric(
        "e_3d_centred",
        _centred,
        "`e_3d` after every body, by true labels, is centred in each frame: shape without placement",
    ),
    Metric("e_3d_body", _by_body, "`e_3d` of each body, centred and aligned by itself: `e_3d_body_0` and so on"),
    Metric(
        "reprojection",
        _reprojection,
        r"$\lVert W - \hat R \hat S \rVert / \lVert W \rVert$, of the visible tracks, centred",
        absent=NO_CAMERAS,
        summary="{reprojection:.3g} of the tracks' size, {rms:.3g} in their units (rms)",
    ),
    _trusted("expected_e_3d", "the `e_3d_dai` to expect, [without the truth](trust.md)", label="expected e_3D"),
    _trusted("expected_depth", "the part of `expected_e_3d` that images leave open"),
    _trusted("expected_cameras", "the part of `expected_e_3d` that estimated cameras bring"),
    _trusted("expected_images", "the part of `expected_e_3d` that tracks bring which the structure does not fit"),
    _trusted("camera_turn", "degrees over which the cameras' viewing directions are spread", unit=""),
    _trusted("depth_ratio", "spread of depth over that of an image axis", unit=""),
    Metric(
        "e_r",
        _rotation,
        "of estimated cameras: mean over frames of the spectral norm of the difference, after one orthogonal matrix",
        label="e_R",
        tex="$e_R$",
        unit="",
        absent="no structure to compare, or no camera is known",
        summary="{e_r:.4f}",
    ),
    Metric(
        "n_wrong",
        _wrong,
        "wrongly labelled tracks under the best one-to-one matching of clusters to bodies",
        label="wrong tracks",
        unit="tracks",
        absent=NO_LABELS,
        brief="wrong {:.0f}/{}",
    ),
    Metric(
        "e_ms",
        lambda e: _wrong(e) / len(e.true_labels),
        "the share of wrongly labelled tracks: `n_wrong` over all tracks",
        label="e_MS",
        tex="$e_{MS}$",
        unit="share",
        absent=NO_LABELS,
        counts="n_wrong",
        tolerance=1,
        summary="{e_ms:.4f}, {n_wrong:.0f} of {n_points} tracks wrong",
    ),
    Metric(
        "affinity_between",
        lambda e: affinity_between(needed(e.found.affinity), e.true_labels),
        "the share of the affinity that joins tracks of different bodies: 0 where it is block-diagonal",
        unit="share",
        absent="method gives no affinity",
    ),
    Metric(
        "n_bodies_found",
        _clusters,
        "how many bodies the method found",
        label="bodies found",
        brief="bodies {0:g}",
        unit="bodies",
        better="",
        absent=NO_LABELS,
        counted=True,
    ),
    Metric(
        "eigengap",
        _eigengap,
        "the gap after the n-th eigenvalue of the affinity's Laplacian, n the number of clusters",
        unit="",
        better="",
        absent=NO_LABELS,
        counted=True,
    ),
    Metric(
        "miscounted",
        lambda e: float(_clusters(e) != needed(e.scene.n_bodies)),
        "1 where the number of bodies found is not the scene's, 0 where it is",
        label="wrong number",
        unit="share",
        absent=NO_LABELS,
        counted=True,
    ),
)

#: Logged name -> its entry.
BY_NAME: Mapping[str, Metric] = MappingProxyType({metric.name: metric for metric in METRICS})
