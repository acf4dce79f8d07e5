"""The charts of the report, as data: a new chart is a new entry of :data:`CHARTS`."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TypeVar

from nrsfm.harness.evaluate.metrics import BY_NAME
from nrsfm.harness.record.curves import thinned
from nrsfm.harness.record.outcome import OK, Outcome
from nrsfm.harness.record.text import one_line
from nrsfm.harness.record.tracked import Answer, Fetch, Tracked
from nrsfm.reports.figures.affinity import picture
from nrsfm.reports.figures.chart import Chart, Panel, Series
from nrsfm.reports.figures.scaling_chart import scaling
from nrsfm.reports.layouts.index import layout
from nrsfm.reports.layouts.labels import method_label

T = TypeVar("T")
K = TypeVar("K")
Runs = Sequence[Tracked]
Build = Callable[[Runs, Fetch], Iterable[Panel]]


@dataclass(frozen=True)
class ChartEntry:
    """A chart and the experiments that fill it."""

    name: str  #: the stem of its files is the experiment's name and this
    title: str
    caption: str
    experiments: tuple[str, ...]  #: names or patterns, such as ``noise*``
    build: Build  #: finished runs and their arrays -> panels; none where the runs lack what the chart shows


def build_charts(answers_by_table: Mapping[str, Sequence[Answer]], fetch: Fetch) -> list[Chart]:
    """Every chart that the answers fill, in the order of :data:`CHARTS`."""
    made = []
    for entry in CHARTS:
        for name, answers in answers_by_table.items():
            if not any(fnmatchcase(name, pattern) for pattern in entry.experiments):
                continue
            runs = list({run.outcome.key: run for _, run in answers if run and run.outcome.status == OK}.values())
            panels = tuple(entry.build(runs, fetch))
            if panels:
                title = f"{entry.title}, {layout(name).title}" if len(entry.experiments) > 1 else entry.title
                made.append(Chart(f"{name}_{entry.name}", title, entry.caption, panels))
    return made


def against_noise(metric: str) -> Build:
    """A metric against the noise level: all datasets together, then each; mean and spread over the draws."""

    def build(runs: Runs, _: Fetch) -> Iterator[Panel]:
        outcomes = [run.outcome for run in runs if metric in run.outcome.metrics]
        if len({o.level for o in outcomes}) < 2:
            return
        methods = _methods(runs)
        several = len({o.cameras for o in outcomes}) > 1
        words = {o.cameras: f", cameras {o.cameras}" if several else "" for o in outcomes}
        groups = _by(outcomes, lambda o: "all scenes" + words[o.cameras])
        groups |= _by(outcomes, lambda o: _name_of(o.dataset) + words[o.cameras])
        for title, members in groups.items():
            by_method = _by(members, lambda o: o.method).items()
            series = (_over_levels(name, methods.index(name), group, metric) for name, group in by_method)
            yield Panel(title, "noise, share of max |W|", BY_NAME[metric].label, tuple(series))

    return build


def _over_levels(method: str, place: int, outcomes: Sequence[Outcome], metric: str) -> Series:
    """Mean over scenes within a draw, then mean and sample standard deviation over draws."""
    x, y, spread = [], [], []
    for level, members in sorted(_by(outcomes, lambda o: o.level).items()):
        draws = [
            statistics.fmean(o.metrics[metric] for o in draw) for draw in _by(members, lambda o: o.repeat).values()
        ]
        x.append(level)
        y.append(statistics.fmean(draws))
        spread.append(statistics.stdev(draws) if len(draws) > 1 else 0.0)
    return Series(method_label(method), tuple(x), tuple(y), tuple(spread), place)


def convergence(runs: Runs, fetch: Fetch) -> Iterator[Panel]:
    """Objective and residuals by iteration; a panel for each method and curve, a line for each scene."""
    scenes = list(dict.fromkeys(run.outcome.dataset for run in runs))
    for method, members in _by(runs, lambda run: run.outcome.method).items():
        curves = {run.outcome.dataset: thinned(fetch(run)) for run in members}
        names = {name for curve in curves.values() for name in curve}
        for name in sorted(names, key=lambda name: (name != "objective", name)):
            series = [
                Series(_name_of(scene), tuple(map(float, x)), tuple(map(float, y)), (), scenes.index(scene))
                for scene, curve in curves.items()
                if name in curve
                for x, y in [curve[name]]
            ]
            title = name.removeprefix("residual_") + " residual" * (name != "objective")
            yield Panel(f"{method_label(method)}: {title}", "iteration", "", tuple(series), log_y=name != "objective")


def affinities(runs: Runs, fetch: Fetch) -> Iterator[Panel]:
    """SSC's affinity beside ours, scene by scene."""
    wanted = ("ssc2d", "ours")
    for scene, members in _by(runs, lambda run: run.outcome.dataset).items():
        pair = {run.outcome.method: run for run in members if run.outcome.method in wanted and not run.outcome.level}
        if set(pair) != set(wanted):
            continue
        for method in wanted:
            arrays, outcome = fetch(pair[method]), pair[method].outcome
            if "affinity" not in arrays:
                continue
            A, edges = picture(arrays["affinity"], arrays.get("true_labels"))
            between = outcome.metrics.get("affinity_between")
            share = f", {100 * between:.0f} % between" if between is not None else ""
            title = f"{_name_of(scene)}: {method_label(method)}{share}"
            yield Panel(title, "track", "track", (), A, tuple(map(int, edges)))


def by_frame(runs: Runs, fetch: Fetch) -> Iterator[Panel]:
    """e_3D of each frame, a panel for each scene and a line for each method."""
    methods = _methods(runs)
    for scene, members in _by([r for r in runs if not r.outcome.level], lambda run: run.outcome.dataset).items():
        series = []
        for run in members:
            errors = fetch(run).get("frame_e_3d")
            if errors is not None:
                x = tuple(float(i + 1) for i in range(len(errors)))
                place = methods.index(run.outcome.method)
                series.append(Series(method_label(run.outcome.method), x, tuple(map(float, errors)), (), place))
        if series:
            yield Panel(_name_of(scene), "frame", BY_NAME["e_3d"].label, tuple(series))


def cost(runs: Runs, _: Fetch) -> Iterator[Panel]:
    """Seconds and memory of each run against the size of its scene."""
    methods = _methods(runs)
    for title, unit, of in (("time", "s", "seconds"), ("memory", "MB", "peak_mb")):
        series = []
        for method, members in _by([run.outcome for run in runs], lambda o: o.method).items():
            points = sorted(
                ((o.n_points or 0) * (o.n_frames or 0), value)
                for o in members
                if (value := getattr(o, of)) and o.n_points and o.n_frames
            )
            if points:
                x, y = zip(*points, strict=True)
                series.append(Series(method_label(method), x, y, (), methods.index(method), scatter=True))
        if series:
            spans = ([v for s in series for v in getattr(s, axis)] for axis in "xy")
            wide_x, wide_y = (max(values) > 10 * min(values) > 0 for values in spans)
            yield Panel(title, "tracks × frames", unit, tuple(series), log_x=wide_x, log_y=wide_y)


def _by(items: Iterable[T], key: Callable[[T], K]) -> dict[K, list[T]]:
    groups: dict[K, list[T]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def _methods(runs: Runs) -> list[str]:
    return list(dict.fromkeys(run.outcome.method for run in runs))


def _name_of(dataset: str) -> str:
    return one_line(dataset.replace("_", " + "), 40)


CHARTS: tuple[ChartEntry, ...] = (
    ChartEntry(
        "e_3d",
        "3D error against noise",
        "e_3D against the noise's standard deviation; lines are means, bands the sample standard deviation over the "
        "draws. The paper prints no standard deviation: the scale of the noise is this project's.",
        ("noise*",),
        against_noise("e_3d"),
    ),
    ChartEntry(
        "e_ms",
        "Segmentation error against noise",
        "Share of wrongly labelled tracks against the noise's standard deviation; lines are means, bands the sample "
        "standard deviation over the draws.",
        ("noise*",),
        against_noise("e_ms"),
    ),
    ChartEntry(
        "curves",
        "Convergence",
        "Objective and the infinity norms of the constraints' residuals by iteration.",
        ("convergence*",),
        convergence,
    ),
    ChartEntry(
        "affinity",
        "Affinity of SSC beside ours",
        "What is clustered, normalised as spectral clustering does; tracks sorted by body, darker is stronger, lines "
        "part the bodies. In the titles, the share of the affinity between bodies.",
        ("table1",),
        affinities,
    ),
    ChartEntry(
        "cost",
        "Time and memory of an iteration",
        "Each point is a trial, double logarithmic; exponents are those of the larger half of the sizes. A dense "
        "iteration's operations and a dense P x P array stand beside.",
        ("scaling",),
        scaling,
    ),
    ChartEntry("frames", "3D error by frame", "e_3D of each frame.", ("table2", "table3"), by_frame),
    ChartEntry(
        "cost",
        "Time and memory",
        "Each point is a run: wall time and largest resident memory against the size of the scene.",
        ("table2", "table3", "table4"),
        cost,
    ),
)
