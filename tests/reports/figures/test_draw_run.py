"""The overview figure draws what the arrays hold, and the README's tables are renewed in place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.typing import NDArray

from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.matching import matched
from nrsfm.harness.evaluate.metric_type import needed
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.outcome import Outcome
from nrsfm.reports.figures.affinity import binned
from nrsfm.reports.figures.draw_run import overview, save
from nrsfm.reports.figures.style import COLOURS
from nrsfm.reports.formats.embed import update_document
from nrsfm.reports.tables.build import build
from nrsfm.reports.tables.model import Verdict


@pytest.fixture
def outcome() -> Outcome:
    return Outcome(
        "k" * 16, "s" * 16, "ok", "person_face", "ours", "known", "paper", "registered", 0.0, 0,
        n_points=30, metrics={"e_3d": 0.05, "n_wrong": 2},
    )  # fmt: skip


@pytest.fixture
def arrays(small_scene: Scene) -> dict[str, NDArray[Any]]:
    truth, true_labels = needed(small_scene.structure), needed(small_scene.labels)
    labels = 1 - true_labels
    labels[[0, 20]] = 1 - labels[[0, 20]]
    return {
        "tracks": small_scene.tracks,
        "structure": truth,
        "true_structure": truth,
        "labels": labels,
        "true_labels": true_labels,
        "affinity": np.abs(np.subtract.outer(labels, labels)) + 0.1,
    }


def test_wrong_tracks_alone_are_crossed(arrays: dict[str, NDArray[Any]], outcome: Outcome) -> None:
    figure = overview(arrays, outcome)
    assert [axes.get_title() for axes in figure.axes][1:] == [
        "structure over the truth (circles)",
        "affinity, tracks sorted by body",
    ]
    crosses = figure.axes[1].collections[-1]
    assert len(np.asarray(crosses.get_offsets())) == 2
    drawn = {tuple(np.round(c.get_facecolor()[0][:3], 2)) for c in figure.axes[1].collections[1:3]}
    assert len(drawn) == 2
    assert "wrong 2/30" in figure.get_suptitle()


def test_absent_parts_are_not_drawn(arrays: dict[str, NDArray[Any]], outcome: Outcome) -> None:
    only = {name: arrays[name] for name in ("tracks", "labels")}
    assert len(overview(only, outcome).axes) == 1
    blind = {name: value for name, value in arrays.items() if not name.startswith("true_")}
    assert len(overview(blind, outcome).axes) == 3


def test_a_sparse_affinity_is_drawn_as_the_dense_one(arrays: dict[str, NDArray[Any]], outcome: Outcome) -> None:
    images = [
        np.asarray(overview(arrays | {"affinity": affinity}, outcome).axes[2].images[0].get_array())
        for affinity in (arrays["affinity"], sp.csr_array(arrays["affinity"]))
    ]
    np.testing.assert_allclose(images[1], images[0])


def test_a_large_affinity_is_summed_over_cells() -> None:
    pairs = (np.array([0, 999, 999]), np.array([1, 0, 998]))
    image = binned(sp.coo_array((np.array([2.0, 3.0, 4.0]), pairs), shape=(1000, 1000)), np.arange(1000)[::-1])
    assert image.shape == (400, 400) and image.sum() == 9
    assert (image[399, 399], image[0, 399], image[0, 0]) == (2, 3, 4)


def test_clusters_take_the_names_of_their_bodies() -> None:
    truth = np.repeat([0, 1], 5)
    assert (matched(1 - truth, truth) == truth).all()
    split = np.array([7, 7, 7, 7, 3, 2, 2, 2, 2, 2])
    named = matched(split, truth)
    assert named[[0, 5]].tolist() == [0, 1]
    assert named[4] not in (0, 1)
    assert len(set(COLOURS)) == len(COLOURS)


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_same_figure_same_bytes(arrays: dict[str, NDArray[Any]], outcome: Outcome, tmp_path: Path, suffix: str) -> None:
    paths = [tmp_path / f"{k}.{suffix}" for k in (0, 1)]
    for path in paths:
        save(overview(arrays, outcome), path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].stat().st_size > 5000


def test_tables_are_renewed_between_their_marks(tmp_path: Path) -> None:
    table = build("table1", [])
    path = tmp_path / "README.md"
    path.write_text("before\n<!-- table1 -->\nold\n<!-- end table1 -->\nafter\n")
    update_document(path, [table])
    text = path.read_text()
    assert text.startswith("before\n<!-- table1 -->\n")
    assert text.endswith("<!-- end table1 -->\nafter\n")
    assert "old" not in text
    assert "| Dance+Yoga |" in text
    update_document(path, [table])
    assert path.read_text() == text
    path.write_text("no marks")
    with pytest.raises(UsageError, match="table1"):
        update_document(path, [table])


def test_the_tally_counts_what_was_reproduced(tmp_path: Path, table1_answers: list[Any]) -> None:
    table, study = build("table1", table1_answers), build("rank_study", [])
    path = tmp_path / "page.md"
    path.write_text("<!-- tally -->\n<!-- end tally -->\n<!-- rank_study -->\n<!-- end rank_study -->\n")
    update_document(path, [table, study])
    text = path.read_text()
    reproduced, better, worse = (table.verdicts[v] for v in (Verdict.REPRODUCED, Verdict.BETTER, Verdict.WORSE))
    assert f"| Table 1 | 24 | {reproduced} | {better} | {worse} | {24 - reproduced - better - worse} |" in text
    assert "| Table 2 by the rank of the shape |" not in text and "Dance + Yoga" in text
