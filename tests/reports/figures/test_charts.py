"""Charts: which runs a line takes, what it makes of them, and that both drawings show the same."""

from __future__ import annotations

import statistics
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nrsfm.harness.evaluate.metric_type import needed
from nrsfm.harness.record.tracked import Tracked
from nrsfm.reports.figures.affinity import picture
from nrsfm.reports.figures.chart import Chart
from nrsfm.reports.figures.charts import CHARTS, build_charts
from nrsfm.reports.figures.draw_chart import chart_figure
from nrsfm.reports.figures.draw_run import save
from nrsfm.reports.figures.page_data import Blobs
from nrsfm.reports.figures.style import look
from tests.reports.conftest import make_answer


def no_arrays(run: Tracked) -> dict[str, Any]:
    return {}


def noisy(**more: Any) -> list[Any]:
    """Two scenes, two methods, three levels, three draws; the error is level + draw / 100, twice that on one scene."""
    return [
        make_answer(scene, method, 0, e_3d=factor * (level + repeat / 100), level=level, repeat=repeat, **more)
        for scene, factor in (("dance_yoga", 1), ("face_yoga", 2))
        for method in ("ours", "ssc2d")
        for level in (0.0, 0.02, 0.05)
        for repeat in ((0, 1, 2) if level else (0,))
    ]


def one(name: str, answers: dict[str, Any], fetch: Any = no_arrays) -> Chart:
    (chart,) = [chart for chart in build_charts(answers, fetch) if chart.name == name]
    return chart


def test_noise_lines_are_means_with_the_spread_over_draws() -> None:
    chart = one("noise_e_3d", {"noise": noisy()})
    assert [panel.title for panel in chart.panels] == ["all scenes", "dance + yoga", "face + yoga"]
    line = chart.panels[0].series[0]
    assert line.x == (0.0, 0.02, 0.05)
    draws = [1.5 * (0.05 + repeat / 100) for repeat in range(3)]
    assert line.y[2] == pytest.approx(statistics.fmean(draws))
    assert line.spread[2] == pytest.approx(statistics.stdev(draws))
    assert line.spread[0] == 0
    assert [series.label for series in chart.panels[0].series] == ["Ours", "SSC(2D)"]


def test_one_level_is_no_noise_figure() -> None:
    assert build_charts({"noise": [make_answer("dance_yoga", "ours", 0, e_3d=0.1)]}, no_arrays) == []


def test_failed_and_absent_runs_are_not_drawn() -> None:
    answers = [*noisy(), make_answer("dance_yoga", "edsc", status="failed", level=0.02)]
    labels = [series.label for series in one("noise_e_3d", {"noise": answers}).panels[0].series]
    assert labels == ["Ours", "SSC(2D)"]


def test_convergence_has_a_panel_a_curve_and_a_line_a_scene() -> None:
    curves = {"history_objective": np.arange(1.0, 9), "history_shape": 0.5 ** np.arange(8), "history_code": np.ones(8)}
    answers = [make_answer(scene, "ours", 0) for scene in ("dance_yoga", "face_yoga")]
    chart = one("convergence_curves", {"convergence": answers}, lambda run: curves)
    assert [panel.title for panel in chart.panels] == ["Ours: objective", "Ours: code residual", "Ours: shape residual"]
    assert [panel.log_y for panel in chart.panels] == [False, True, True]
    assert [series.label for series in chart.panels[0].series] == ["dance + yoga", "face + yoga"]
    assert chart.panels[2].series[0].y == pytest.approx(curves["history_shape"])


def test_affinities_stand_in_pairs_sorted_by_body() -> None:
    truth = np.array([1, 0, 1, 0])
    same = (truth[:, None] == truth[None, :]) & ~np.eye(4, dtype=bool)
    fetch = lambda run: {"affinity": same.astype(float), "true_labels": truth}  # noqa: E731
    answers = [make_answer("dance_yoga", method, 0) for method in ("ours", "ssc2d", "edsc")]
    chart = one("table1_affinity", {"table1": answers}, fetch)
    assert [panel.title for panel in chart.panels] == ["dance + yoga: SSC(2D)", "dance + yoga: Ours"]
    np.testing.assert_allclose(needed(chart.panels[0].matrix), np.kron(np.eye(2), [[0, 1], [1, 0]]))
    assert chart.panels[0].edges == (2,)


def test_normalised_affinity_has_the_rows_of_spectral_clustering(rng: np.random.Generator) -> None:
    A = rng.random((6, 6))
    A = A + A.T
    normal, _ = picture(A, None)
    D = np.diag(A.sum(axis=1) ** -0.5)
    expected = D @ A @ D
    np.testing.assert_allclose(normal, np.minimum(expected, np.quantile(expected, 0.98)))
    assert np.isfinite(picture(np.zeros((3, 3)), None)[0]).all()


def test_looks_differ() -> None:
    looks = [look(place) for place in range(18)]
    assert len({(each.colour, each.marker, each.line) for each in looks}) == 18
    assert len({(each.colour, each.symbol, each.dash) for each in looks}) == 18


@pytest.mark.parametrize("suffix", ["svg", "pdf", "png"])
def test_files_have_every_line_and_the_same_bytes_twice(tmp_path: Path, suffix: str) -> None:
    chart = one("noise_e_ms", {"noise": noisy()})
    figure = chart_figure(chart)
    assert [len(axes.lines) for axes in figure.axes] == [2, 2, 2]
    paths = [tmp_path / f"{k}.{suffix}" for k in (0, 1)]
    for path in paths:
        save(chart_figure(chart), path)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_the_page_gets_the_same_numbers() -> None:
    chart = one("noise_e_3d", {"noise": noisy()})
    data = chart.data(Blobs())
    assert [panel["title"] for panel in data["panels"]] == [panel.title for panel in chart.panels]
    drawn = data["panels"][0]["series"][1]
    assert drawn["y"] == pytest.approx(chart.panels[0].series[1].y)


def test_the_catalogue_names_each_figure_once_an_experiment() -> None:
    names = [(figure.name, pattern) for figure in CHARTS for pattern in figure.experiments]
    assert len(names) == len(set(names))
