"""The logged numbers that tables print, as their metrics."""

from __future__ import annotations

from dataclasses import replace

from nrsfm.reports.layouts.layout import E_3D, E_MS, Metric

E_R = Metric("e_r", "e_R", "$e_R$", logged="e_r", absent="method gives no structure, or no camera is known")


E_3D_ALIGNED = replace(E_3D, name="e_3d_dai")


E_3D_CAMERA = Metric(
    "e_3d_dai_cam",
    "e_3D, camera frame",
    "$e_{3D}$, camera frame",
    logged="e_3d_dai_cam",
    absent="method gives no structure",
)


E_3D_KNOWN = replace(E_3D, name="e_3d_gt_rotation")


E_3D_EQUATION = replace(E_3D, logged="e_3d")


MEAN = Metric(
    "mean", "mean %", r"mean (\%)", logged="e_ms", tolerance=0.2, absent=E_MS.absent, pool="mean", percent=True
)


MEDIAN = replace(MEAN, name="median", label="median %", tex=r"median (\%)", pool="median")


MISCOUNTED = Metric(
    "miscounted",
    "wrong number %",
    r"wrong number (\%)",
    logged="miscounted",
    absent=E_MS.absent,
    pool="mean",
    percent=True,
)


MEAN_TRACKS = replace(MEAN, label="wrong tracks %", tex=r"wrong tracks (\%)")


MEAN_3D = replace(E_3D, label="e_3D", pool="mean")


MEAN_HIDDEN = Metric(
    "e_3d_hidden",
    "e_3D of hidden points",
    "$e_{3D}$ of hidden points",
    logged="e_3d_hidden",
    absent="method gives no structure, or nothing is hidden",
    pool="mean",
)


FOUND = Metric("n_bodies_found", "bodies found", "bodies found", logged="n_bodies_found", absent=E_MS.absent)


EIGENGAP = Metric("eigengap", "eigengap", "eigengap", logged="eigengap", absent=E_MS.absent)
