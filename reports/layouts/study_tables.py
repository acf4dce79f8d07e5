"""The tables of this project's own experiments, as data: columns or rows are the variants."""

from __future__ import annotations

from collections.abc import Mapping

from nrsfm.reports.layouts import notes, published
from nrsfm.reports.layouts import table_metrics as metrics
from nrsfm.reports.layouts.layout import Layout, Method, Pool, SameAs, columns
from nrsfm.reports.layouts.paper_tables import BODIES, HOPKINS

#: Distances of a scene's eight pairs from the published numbers.
FROM_TABLE2 = (
    metrics.pooled(metrics.E_3D, "log ratio", title="e_3D, log ratio"),
    metrics.pooled(metrics.E_3D, "> 10 % off", title="e_3D, pairs off"),
    metrics.pooled(metrics.TableMetric("e_3d"), "log ratio", title="e_3D by the equation, log ratio"),
    metrics.pooled(metrics.E_MS, "tracks off", title="e_MS, tracks off"),
)

#: Settings of the block matrix method's rotation step as published.
ROTATION = {"cameras.rank": SameAs("dataset.rank"), "cameras.start": "trace_norm", "cameras.refine": True}

#: A column of the adaptive method for each setting of the search.
SETTINGS = tuple(
    Method("adaptive", where={"method.l1": l1, "method.whitening": whitening}, label=f"l1 {l1}, whitening {whitening}")
    for l1 in ([0.1, 0.3], [0.1, 0.1], [0.3, 0.3])
    for whitening in ([0.7, 0.5], [0.5, 0.5], [0.7, 0.7])
)

#: Frames over which structure keeps still.
SMOOTHINGS = (0, 10, 20, 30, 50, 100, 1000)

STUDY_TABLES: Mapping[str, Layout] = {
    "rotation_ablation": Layout(
        title="Single bodies, the rotation without one ingredient",
        caption="The block matrix method with cameras from the tracks alone: its rotation step whole (trace-norm "
        "start, refined, K as published) and with one choice changed.",
        methods=tuple(
            Method("bmm", where={**ROTATION, **changed}, label=label)
            for label, changed in (
                ("whole", {}),
                ("K = 13", {"cameras.rank": 13}),
                ("not refined", {"cameras.refine": False}),
                ("rigid start", {"cameras.start": "rigid"}),
                ("rigid start, not refined", {"cameras.start": "rigid", "cameras.refine": False}),
            )
        ),
        metrics=(metrics.E_R, metrics.E_3D_ALIGNED, metrics.E_3D_CAMERA),
        source="single_body",
        points="single_body",
        study=True,
        notes=(
            notes.FIXED,
            "K = 13 is the most that 40 tracks allow, for the rotation alone; the shape keeps its own.",
        ),
    ),
    "scene_study": Layout(
        title="Which scene is the paper's",
        caption="Distance of the baselines from Tables 1 and 2 over the eight pairs, one candidate scene a row. "
        "e_3D of BMM: root mean square of log(measured / printed), by e_3d_dai and by the paper's equation e_3d, "
        "and the pairs that are off by more than 10 %. e_MS: sum over the pairs of |wrong tracks - printed wrong "
        "tracks|; the pairs have 816 tracks.",
        methods=(
            Method("bmm_ssc3d", metrics=FROM_TABLE2),
            Method("bmm_ssc3d_k6", printed="bmm_ssc3d", metrics=FROM_TABLE2),
            Method("ssc2d", source="table1", metrics=FROM_TABLE2[-1:]),
            Method("edsc", source="table1", metrics=FROM_TABLE2[-1:]),
        ),
        source="table2",
        points="table1",
        pools={"pairs": Pool("", published.datasets("table2"))},
        parts=Layout(
            "Pair by pair",
            "",
            methods=(
                Method("bmm_ssc3d"),
                Method("bmm_ssc3d_k6", printed="bmm_ssc3d"),
                Method("ssc2d", source="table1", metrics=(metrics.E_MS,)),
                Method("edsc", source="table1", metrics=(metrics.E_MS,)),
            ),
            source="table2",
            points="table1",
            joiner=" + ",
            study=True,
        ),
        study=True,
    ),
    "rank_study": Layout(
        title="Table 2 by the rank of the shape",
        caption="e_3D of the block matrix method on the eight pairs, its structure cut to rank K, beside the "
        "printed number of BMM + SSC(3D), which names no K.",
        methods=tuple(
            Method("bmm", printed="bmm_ssc3d", where={"method.rank": K}, label=f"K = {K}" if K else "not cut")
            for K in (5, 6, 7, 11, 16, None)
        ),
        metrics=(metrics.E_3D,),
        source="table2",
        points="table1",
        joiner=" + ",
        study=True,
    ),
    "adaptive_search": Layout(
        title="The setting of the adaptive method",
        caption="Wrong tracks of the eight pairs by the weight of the sparse code (l1) and the whitening, each for "
        "clean and for noisy tracks.",
        methods=SETTINGS,
        metrics=(metrics.MEAN_TRACKS,),
        pools={"pairs": BODIES["pairs"]},
        parts=Layout("Pair by pair", "", methods=SETTINGS, metrics=(metrics.E_3D, metrics.E_MS)),
    ),
    "smoothing": Layout(
        title="The smoothness of structure",
        caption="The eight pairs by the frames over which structure keeps still; 0 leaves the order of the frames "
        "out. Means over the pairs.",
        methods=tuple(
            Method("adaptive", where={"method.smoothing": t}, label=f"{t} frames" if t else "no order")
            for t in SMOOTHINGS
        ),
        metrics=(metrics.MEAN_3D, metrics.MEAN_TRACKS),
        pools={"pairs": BODIES["pairs"]},
        parts=Layout("Pair by pair", ""),
    ),
    "ablation": Layout(
        title="What each ingredient is worth",
        caption="The eight pairs, clean and with 1 and 3 per cent of noise, cameras known and from the tracks: means "
        "over the pairs.",
        methods=columns(
            *("adaptive", "adaptive_apart", "adaptive_no_order", "adaptive_no_nuclear", "adaptive_not_whitened"),
            *("ours", "ours_exact", "ours_diag", "ours_no_nuclear"),
            *("ssc2d_share70", "bmm_ssc3d_share70"),
        ),
        metrics=(metrics.MEAN_3D, metrics.MEAN_TRACKS),
        pools={"pairs": BODIES["pairs"]},
        parts=Layout("Pair by pair", ""),
        notes=(notes.ADAPTIVE, notes.SHARE),
    ),
    "gaps": Layout(
        title="Missing observations",
        caption="The eight pairs with 10, 20 and 30 % of the observations dropped: means over the pairs.",
        methods=(
            *columns("ssc2d_share70", "edsc", metrics=(metrics.MEAN_TRACKS,)),
            *columns("bmm_ssc3d_share70", "adaptive"),
        ),
        metrics=(metrics.MEAN_3D, metrics.MEAN_HIDDEN, metrics.MEAN_TRACKS),
        pools={"pairs": BODIES["pairs"]},
        parts=Layout("Pair by pair", "", metrics=(metrics.E_3D, metrics.E_3D_HIDDEN, metrics.E_MS)),
        notes=(notes.HIDDEN, notes.ADAPTIVE),
    ),
    "count_bodies": Layout(
        title="How many bodies",
        caption="Share of scenes whose number of bodies a method gets wrong, and of wrong tracks, when it has to "
        "estimate the number.",
        methods=columns("ssc2d", "ssc2d_share70", "edsc", "ours", "adaptive"),
        metrics=(metrics.MISCOUNTED, metrics.MEAN_TRACKS),
        pools=BODIES,
        parts=Layout("Scene by scene", "", metrics=(metrics.FOUND, metrics.EIGENGAP, metrics.E_MS)),
        notes=(notes.EIGENGAPS, notes.SHARE, notes.ADAPTIVE),
    ),
    "count_hopkins155": Layout(
        title="How many motions",
        caption="Share of the scenes of Hopkins155 whose number of motions a method gets wrong, and of wrong "
        "tracks, when it has to estimate the number.",
        methods=columns("ssc_raw", "edsc_raw"),
        metrics=(metrics.MISCOUNTED, metrics.MEAN_TRACKS),
        pools=HOPKINS,
        parts=Layout("Scene by scene", "", metrics=(metrics.FOUND, metrics.EIGENGAP, metrics.E_MS)),
        notes=(notes.EIGENGAPS,),
    ),
}
