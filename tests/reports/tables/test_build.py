"""The table model: what stands in a cell, what is best, and what may be said about it."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import nrsfm.reports.paper
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.trial import Trial
from nrsfm.reports.formats import documents as writers
from nrsfm.reports.layouts import published
from nrsfm.reports.layouts.baseline import wrong_tracks
from nrsfm.reports.layouts.index import LAYOUTS
from nrsfm.reports.layouts.layout import Layout, Method
from nrsfm.reports.layouts.table_metrics import E_3D, E_MS
from nrsfm.reports.tables.build import build
from nrsfm.reports.tables.model import Cell, Table, Verdict
from tests.reports.conftest import Answers, MakeAnswer


def cell(table: Table, dataset: str, method: str, metric: str = "e_ms", stand_in: bool = False) -> Cell:
    """The one cell of a dataset, method and metric."""
    found = [
        c
        for row, column, c in table.cells()
        if (row.dataset, column.method, column.metric.name, row.stand_in) == (dataset, method, metric, stand_in)
    ]
    assert len(found) == 1, f"{len(found)} cells for {dataset} {method} {metric}"
    return found[0]


class TestPublished:
    @pytest.mark.parametrize("name", list(published.SOURCES))
    def test_every_number_of_every_file_is_found(self, name: str) -> None:
        source = published.SOURCES[name]
        lines = (Path(nrsfm.reports.paper.__file__).parent / source.file).read_text().splitlines()
        rows = list(csv.DictReader(lines))
        numbers = len(source.methods) or len(source.metrics) or 1
        found = [
            published.printed(name, dataset, method, metric)
            for dataset in published.datasets(name)
            for method in published.methods(name)
            for metric in {m for _, _, m in published._numbers(name)}
        ]
        assert len([text for text in found if text is not None]) == len(rows) * numbers

    def test_strings_stay_as_printed(self) -> None:
        assert published.printed("table1", "dance_yoga", "ssc2d", "e_ms") == "0.025"
        assert published.printed("table2", "dance_yoga", "ssc2d_bmm", "e_ms") == "0.0259"
        assert published.printed("table2", "walking_yoga", "ssc2d_bmm", "e_3d") == "0.0900"
        assert published.printed("table2", "dance_yoga", "ours", "e_3d") == "0.046"
        assert published.printed("table4", "face2", "ours_cd", "e_3d") == "0.050"
        assert published.printed("pairs_followup", "dance_yoga", "zhu", "e_3d") == "0.052"
        assert published.printed("single_body", "drink", "pta_stored", "e_3d") == "0.0160"
        assert published.printed("hopkins155", "3", "ssc", "mean") == "4.40"

    def test_absent_numbers_are_none_and_absent_tables_an_error(self) -> None:
        assert published.printed("table1", "dance_yoga", "ssc2d", "e_3d") is None
        assert published.printed("table1", "nobody", "ssc2d", "e_ms") is None
        with pytest.raises(UsageError, match="table9"):
            published.printed("table9", "dance_yoga", "ssc2d", "e_ms")

    def test_points_and_order(self) -> None:
        assert published.points("table1", "dance_yoga") == 116
        assert published.points("table2", "dance_yoga") is None
        assert published.datasets("table2")[0] == "dance_yoga"
        assert published.datasets("table2")[-1] == "stretch_yoga"

    @pytest.mark.parametrize(
        ("share", "points", "count"),
        [(0.025, 116, 3), (0.0259, 116, 3), (0.41, 132, 54), (0.098, 81, 8), (0.01, 96, 1)],
    )
    def test_printed_shares_are_whole_tracks(self, share: float, points: int, count: int) -> None:
        assert wrong_tracks(share, points) == count


class TestLayout:
    def test_rows_are_the_papers_in_its_order_whatever_the_order_of_asking(self, table1_answers: Answers) -> None:
        table = build("table1", table1_answers[::-1])
        assert [row.dataset for row in table.rows] == list(published.datasets("table1"))
        assert table.rows[0].label == "Dance+Yoga"
        assert build("table2", []).rows[0].label == "Dance + Yoga"

    def test_nothing_asked_still_shows_the_published_numbers(self) -> None:
        table = build("table1", [])
        assert len(table.rows) == 8
        found = cell(table, "dance_yoga", "ssc2d")
        assert (found.published, found.measured, found.reason) == ("0.025", None, "not asked")

    def test_columns_of_the_paper_and_of_the_audit(self, table1_answers: Answers) -> None:
        columns = build("table1", table1_answers).columns
        assert [c.method for c in columns] == ["ssc2d", "ssc2d_share70", "edsc", "ours"]
        assert [c.method for c in columns if c.heading] == ["ssc2d", "edsc", "ours"]
        assert [c.method for c in build("table1", []).columns] == ["ssc2d", "edsc", "ours"]

    def test_a_new_method_and_a_new_dataset_get_their_places(self, table1_answers: Answers, answer: MakeAnswer) -> None:
        table = build("table1", [*table1_answers, answer("drink_stretch", "newcomer", 1)])
        assert table.columns[-1].method == "newcomer"
        assert (table.rows[-1].label, table.rows[-1].printed) == ("drink_stretch", False)
        assert cell(table, "drink_stretch", "newcomer").reason == "no published number"

    def test_an_experiment_without_a_layout_shows_what_it_asks_for(self, answer: MakeAnswer) -> None:
        table = build("quick", [answer("person_face", "ours", 1, e_3d=0.1, e_3d_dai=0.2)])
        assert [(c.method, c.metric) for c in table.columns] == [("ours", E_3D), ("ours", E_MS)]
        assert cell(table, "person_face", "ours", "e_3d").measured == 0.2
        assert "no published numbers" in table.summary

    def test_a_further_table_is_data(self, answer: MakeAnswer) -> None:
        design = Layout("Table 3", "UMPM", (Method("ours", "Our Method"),), source="table3")
        table = build("table3", [answer("p2_free_2", "ours", 0, n_points=74, e_3d_dai=0.21)], design)
        assert [row.label for row in table.rows] == list(published.datasets("table3"))
        assert cell(table, "p2_free_2", "ours", "e_3d").verdict is Verdict.REPRODUCED

    @pytest.mark.parametrize("name", ["", "../table1", "a/b", "table1.md", "a b"])
    def test_names_that_no_file_may_have(self, name: str) -> None:
        with pytest.raises(UsageError, match="table name"):
            build(name, [])

    def test_every_layout_names_published_datasets_and_methods(self) -> None:
        """What stands in the paper's own columns is printed, and every study has something to be held against."""
        for design in LAYOUTS.values():
            rows = next(iter(design.pools.values())).datasets if design.study and design.pools else design.datasets
            for method in design.methods:
                metrics = method.metrics or design.metrics
                printed = {(d, m.name) for d in rows for m in metrics if design.printed(d, method, m)}
                if method.heading or design.study:
                    assert {d for d, _ in printed} == set(rows)
                if method.heading:
                    assert {name for _, name in printed} == {m.name for m in metrics}

    def test_no_two_columns_of_a_layout_are_called_alike(self) -> None:
        for design in LAYOUTS.values():
            keys = [method.key for method in design.methods]
            assert len(set(keys)) == len(keys)

    def test_columns_by_a_setting(self, answer: MakeAnswer) -> None:
        """One row a body: what is published for estimated cameras is not held against known ones."""
        found = {"n_points": 41, "e_r": 0.0981, "e_3d_dai": 0.0337, "e_3d_dai_cam": 0.03, "e_3d": 0.02}
        answers = [
            answer("yoga", "bmm", None, cameras="known", **found),
            answer("yoga", "bmm", None, cameras="estimated", **found),
        ]
        table = build("single_body", answers)
        assert len(table.rows) == 8
        (yoga,) = (row for row in table.rows if row.dataset == "yoga")
        assert (yoga.label, yoga.setting.cameras) == ("yoga", "")
        assert [c.published for c in yoga.cells] == ["0.0883", "0.1150", None, "0.0334"]
        verdicts = [Verdict.WORSE, Verdict.BETTER, Verdict.NONE, Verdict.REPRODUCED]
        assert [c.verdict for c in yoga.cells] == verdicts
        assert yoga.cells[2].reason == "no published number"
        assert [c.runs[0].trial_key for c in yoga.cells] == [answers[1][1].outcome.key] * 3 + [
            answers[0][1].outcome.key
        ]
        assert [column.label for column in table.columns] == ["BMM, cameras estimated"] * 3 + ["BMM, cameras known"]

    def test_columns_by_a_setting_that_equals_another(self, answer: MakeAnswer) -> None:
        """The published K differs from row to row, and is one column all the same."""
        changes: dict[str, dict[str, Any]] = {"whole": {}, "K = 13": {"rank": 13}, "rigid start": {"start": "rigid"}}
        answers = [
            answer(name, "bmm", None, cameras=cameras, scene={"rank": K}, n_points=41, e_r=K / 100)
            for name, K in (("yoga", 10), ("pickup", 12))
            for changed in changes.values()
            for cameras in ({"source": "estimated", "rank": K, "start": "trace_norm", "refine": True, **changed},)
        ]
        table = build("rotation_ablation", answers)
        assert list(dict.fromkeys(column.label for column in table.columns)) == list(changes)
        (yoga,) = (row for row in table.rows if row.dataset == "yoga")
        assert [c.measured for c in yoga.cells if c.measured] == [0.1] * 3
        assert yoga.cells[0].published == "0.0883"


class TestVerdict:
    # .025 of 116 is 3 tracks
    @pytest.mark.parametrize(("wrong", "verdict"), [(1, "better"), (2, "reproduced"), (4, "reproduced"), (5, "worse")])
    def test_tracks(self, answer: MakeAnswer, wrong: int, verdict: str) -> None:
        found = cell(build("table1", [answer("dance_yoga", "ssc2d", wrong)]), "dance_yoga", "ssc2d")
        assert (found.verdict, found.difference) == (verdict, wrong - 3)
        assert (found.wrong, found.points) == (wrong, 116)

    # published .0456; ten per cent are .00456
    @pytest.mark.parametrize(
        ("error", "verdict"),
        [(0.04103, "better"), (0.04104, "reproduced"), (0.05016, "reproduced"), (0.05017, "worse")],
    )
    def test_reconstruction_follows_e_3d_dai(self, answer: MakeAnswer, error: float, verdict: str) -> None:
        table = build("table2", [answer("dance_yoga", "bmm_ssc3d", 4, e_3d_dai=error, e_3d=9.0)])
        found = cell(table, "dance_yoga", "bmm_ssc3d", "e_3d")
        assert found.verdict == verdict
        assert (found.measured, found.beside) == (error, 9.0)
        assert found.difference == pytest.approx((error - 0.0456) / 0.0456)

    def test_better_and_worse_say_not_reproduced(self) -> None:
        assert Verdict.BETTER.text == "not reproduced (better)"
        assert Verdict.WORSE.text == "not reproduced (worse)"
        assert Verdict.REPRODUCED.text == "reproduced"

    def test_stand_ins_get_no_verdict(self, answer: MakeAnswer) -> None:
        table = build("table1", [answer("dance_yoga", "ssc2d", 3, stand_in=True)])
        found = cell(table, "dance_yoga", "ssc2d", stand_in=True)
        assert (found.verdict, found.difference) == (Verdict.STAND_IN, None)
        assert table.verdicts[Verdict.REPRODUCED] == 0
        assert table.rows[0].label == "Dance+Yoga (stand-in)"
        assert any("procedural stand-in: the real sequence was not found" in text for text in table.loud)
        assert "1 of them on stand-ins and not compared" in table.summary

    def test_real_and_stand_in_never_share_a_row_or_a_mean(self, answer: MakeAnswer) -> None:
        answers = [
            answer(d, "ours", 2, stand_in=s, repeat=s) for d in ("dance_yoga", "face_yoga") for s in (False, True)
        ]
        table = build("table1", answers)
        assert cell(table, "dance_yoga", "ours").count == 1
        assert cell(table, "dance_yoga", "ours", stand_in=True).count == 1
        assert [row.label for row in table.means] == ["Mean (2 of 8 rows)", "Mean (stand-in)"]

    def test_noise_is_not_what_was_published(self, answer: MakeAnswer) -> None:
        found = cell(build("table1", [answer("dance_yoga", "ssc2d", 3, level=0.02)]), "dance_yoga", "ssc2d")
        assert (found.verdict, found.measured) == (Verdict.NONE, 3 / 116)
        assert "noise" in found.reason

    def test_other_numbers_of_tracks_are_another_scene(self, answer: MakeAnswer) -> None:
        found = cell(build("table1", [answer("dance_yoga", "ssc2d", 3, n_points=100)]), "dance_yoga", "ssc2d")
        assert (found.verdict, found.reason) == (Verdict.NONE, "measured on 100 tracks, published on 116")

    def test_summary_counts(self, answer: MakeAnswer) -> None:
        answers = [answer("dance_yoga", "ssc2d", n) for n in (3,)]
        answers += [
            answer("face_yoga", "ssc2d", 5),
            answer("face_pickup", "ssc2d", 0),
            answer("shark_yoga", "ssc2d", 53),
        ]
        table = build("table1", answers)
        assert table.summary == (
            "Table 1: 2 of 24 published numbers reproduced, 2 not (1 better, 1 worse), 20 not judged, "
            "4 of 24 cells measured."
        )


class TestReasons:
    def test_not_run(self, trial: Callable[..., Trial]) -> None:
        found = cell(build("table1", [(trial("dance_yoga", "ssc2d"), None)]), "dance_yoga", "ssc2d")
        assert (found.measured, found.verdict, found.reason) == (None, Verdict.NONE, "not run")

    @pytest.mark.parametrize(
        ("status", "error", "reason"),
        [
            ("failed", "LinAlgError: no\n\x1b[31mconvergence", "failed: LinAlgError: no [31mconvergence"),
            ("timeout", "", "timeout"),
            ("oom", "over 8 GB", "oom: over 8 GB"),
            ("crashed", "signal 11", "crashed: signal 11"),
        ],
    )
    def test_unfinished(self, answer: MakeAnswer, status: str, error: str, reason: str) -> None:
        found = cell(build("table1", [answer("dance_yoga", "ours", status=status, error=error)]), "dance_yoga", "ours")
        assert (found.measured, found.reason) == (None, reason)
        assert len(found.runs) == 1

    def test_absent_data(self, answer: MakeAnswer) -> None:
        """A row without its data says so, and a note how to get them."""
        how = "umpm/p2_free_2.c3d is not there; ask for a login"
        answers = [answer("p2_free_2", method, status="absent", error=how) for method in ("ours", "bmm_ssc3d")]
        table = build("table3", answers)
        assert {c.reason for row, _, c in table.cells() if row.dataset == "p2_free_2"} >= {"absent"}
        takes = ["p2_free_2", "p3_ball_1", "p4_grab_2", "p4_table_12", "p4_meet_12"]
        assert [row.dataset for row in table.rows] == takes
        assert [text for text in table.loud if "login" in text] == [f"Absent: {how}."]
        assert cell(table, "p2_free_2", "ours", "e_3d").published == "0.1992"
        assert not any(c.measured for _, _, c in table.cells())

    def test_long_errors_are_cut(self, answer: MakeAnswer) -> None:
        table = build("table1", [answer("dance_yoga", "ours", status="failed", error="x" * 9000)])
        assert len(cell(table, "dance_yoga", "ours").reason) < 200

    def test_parts_that_a_method_does_not_give(self, answer: MakeAnswer) -> None:
        table = build("table2", [answer("dance_yoga", "ssc2d", 3), answer("dance_yoga", "bmm", None, e_3d_dai=0.03)])
        assert cell(table, "dance_yoga", "ssc2d", "e_3d").reason == "no structure to compare"
        assert cell(table, "dance_yoga", "bmm", "e_ms").reason == "no labels to compare"

    def test_no_published_number(self, answer: MakeAnswer) -> None:
        table = build("table1", [answer("dance_yoga", "ssc2d_share70", 3)])
        assert cell(table, "dance_yoga", "ssc2d_share70").reason == "no published number"

    def test_an_unfinished_run_goes_with_the_stand_ins_of_its_row(self, answer: MakeAnswer) -> None:
        answers = [answer("dance_yoga", "ours", 1, stand_in=True), answer("dance_yoga", "edsc", status="timeout")]
        table = build("table1", answers)
        assert cell(table, "dance_yoga", "edsc", stand_in=True).reason == "timeout"
        assert len(table.rows) == 8


class TestRepeats:
    def test_mean_and_spread_of_noise_repeats(self, answer: MakeAnswer) -> None:
        answers = [answer("dance_yoga", "ours", n, level=0.02, repeat=r) for r, n in enumerate((2, 4, 6))]
        found = cell(build("table1", answers), "dance_yoga", "ours")
        assert found.measured == pytest.approx(4 / 116)
        assert found.std == pytest.approx(2 / 116)
        assert (found.count, found.wrong, len(found.runs)) == (3, 4, 3)

    def test_a_repeat_without_a_number_is_told(self, answer: MakeAnswer) -> None:
        answers = [answer("dance_yoga", "ssc2d", 3), answer("dance_yoga", "ssc2d", status="timeout", repeat=1)]
        found = cell(build("table1", answers), "dance_yoga", "ssc2d")
        assert (found.verdict, found.count) == (Verdict.NONE, 1)
        assert found.reason == "1 of 2 runs without a number (timeout)"

    def test_settings_of_a_method_are_never_averaged(self, answer: MakeAnswer) -> None:
        answers = [answer("dance_yoga", "ours", n, parameters={"l1": n}) for n in (1, 2)]
        found = cell(build("table1", answers), "dance_yoga", "ours")
        assert (found.measured, found.runs) == (None, ())
        assert "2 settings" in found.reason

    def test_the_same_trial_counts_once(self, answer: MakeAnswer) -> None:
        found = cell(build("table1", [answer("dance_yoga", "ours", 1)] * 2), "dance_yoga", "ours")
        assert found.count == 1

    def test_two_cameras_make_two_rows(self, answer: MakeAnswer) -> None:
        answers = [answer("dance_yoga", "ours", n, cameras=c) for n, c in ((1, "known"), (2, "estimated"))]
        table = build("table1", answers)
        assert [row.label for row in table.rows[:2]] == [
            "Dance+Yoga, cameras known",
            "Dance+Yoga, cameras estimated",
        ]
        assert [row.cells[-1].wrong for row in table.rows[:2]] == [1, 2]
        assert any("not all measured under one setting" in text for text in table.loud)


class TestBest:
    def test_ties_at_the_printed_precision_and_the_papers_own_columns(self, answer: MakeAnswer) -> None:
        errors = {"bmm_ssc3d": 0.05001, "ssc2d_bmm": 0.0503, "ours": 0.05004, "ssc2d_bmm_share70": 0.04}
        table = build("table2", [answer("dance_yoga", m, 0, e_3d_dai=e) for m, e in errors.items()])
        marks = {m: cell(table, "dance_yoga", m, "e_3d") for m in errors}
        assert {m for m, c in marks.items() if c.best} == {"ssc2d_bmm_share70"}
        assert {m for m, c in marks.items() if c.best_printed} == {"bmm_ssc3d", "ours"}

    def test_metrics_are_ranked_apart(self, answer: MakeAnswer) -> None:
        table = build(
            "table2",
            [answer("dance_yoga", "ours", 0, e_3d_dai=0.5), answer("dance_yoga", "bmm_ssc3d", 5, e_3d_dai=0.1)],
        )
        assert cell(table, "dance_yoga", "ours", "e_ms").best
        assert cell(table, "dance_yoga", "bmm_ssc3d", "e_3d").best
        assert not cell(table, "dance_yoga", "ours", "e_3d").best

    def test_alone_nothing_is_best(self, answer: MakeAnswer) -> None:
        assert not cell(build("table1", [answer("dance_yoga", "ours", 0)]), "dance_yoga", "ours").best


class TestMeans:
    def test_over_rows_that_every_measured_column_has(self, answer: MakeAnswer) -> None:
        answers = [answer(d, m, n) for d, m, n in (
            ("dance_yoga", "ours", 1),
            ("dance_yoga", "ssc2d", 3),
            ("drink_walking", "ours", 3),
            ("drink_walking", "ssc2d", 5),
            ("face_yoga", "ours", 40),
        )]  # fmt: skip
        (mean,) = build("table1", answers).means
        ssc, edsc, ours = mean.cells
        assert mean.label == "Mean (2 of 8 rows)"
        assert ours.measured == pytest.approx((1 / 116 + 3 / 96) / 2)
        assert (ours.wrong, ours.points, ours.verdict) == (4, 212, Verdict.NONE)
        assert ssc.published == "0.0125"
        assert edsc.measured is None


class TestNotes:
    def test_one_setting_is_named_once(self, table1_answers: Answers) -> None:
        notes = [note.text for note in build("table1", table1_answers).notes]
        assert "Setting: cameras known, placement paper, motion registered, no noise." in notes
        assert "Scenes: scale = sequence." in notes
        assert "Ours: seed = 0." in notes
        assert not build("table1", table1_answers).loud

    def test_parameters_that_differ_between_rows_are_told_loudly(self, answer: MakeAnswer) -> None:
        answers = [
            answer(d, "ours", 0, parameters={"inner": {"l1": l1}, "l2": 1})
            for d, l1 in (("dance_yoga", 0.003), ("face_yoga", 0.01))
        ]
        (loud,) = build("table1", answers).loud
        assert loud == "Ours: NOT ONE SETTING FOR ALL ROWS: inner.l1 = 0.003 (Dance+Yoga) | 0.01 (Face+Yoga)."

    def test_runs_of_one_environment_need_no_word(self, answer: MakeAnswer) -> None:
        same = {"processor": "A", "numpy": "2.0", "threads": "1", "code": "c", "data": "x"}
        answers = [
            answer("dance_yoga", "ours", 0, environment=same),
            answer("face_yoga", "ours", 0, environment=same | {"data": "y", "packages": "theirs 1 ab"}),
            answer("shark_yoga", "ours", 0, environment={}),  # of a record that says nothing
            answer("face_pickup", "ours", 0, status="failed", environment=same | {"processor": "B"}),
        ]
        assert not [n.text for n in build("table1", answers).notes if "environment" in n.text]

    @pytest.mark.parametrize(
        ("other", "said", "loud"),
        [
            ({"processor": "B"}, "processor = A (2) | B (1)", True),
            ({"threads": "2"}, "threads = 1 (2) | 2 (1)", True),
            ({"numpy": "2.1"}, "numpy = 2.0 (2) | 2.1 (1)", True),
            ({"packages": "theirs 1 cd"}, "package theirs = 1 ab (2) | 1 cd (1)", True),
            (
                {"code": "d", "commit": "f" * 40},
                f"code = c (2) | d (1); commit = {'e' * 12} (2) | {'f' * 12} (1)",
                False,
            ),
        ],
    )
    def test_runs_of_several_environments_are_told_with_what_differs(
        self, answer: MakeAnswer, other: dict[str, str], said: str, loud: bool
    ) -> None:
        same = {"processor": "A", "numpy": "2.0", "threads": "1", "code": "c", "commit": "e" * 40}
        same |= {"packages": "theirs 1 ab"}
        answers = [
            answer(d, "ours", 0, environment=e)
            for d, e in (("dance_yoga", same), ("face_yoga", same), ("shark_yoga", same | other))
        ]
        table = build("table1", answers)
        (note,) = [note for note in table.notes if "environment" in note.text]
        assert f"of one environment: {said}. Times and memory compare within one alone" in note.text
        assert note.loud == loud

    def test_links_are_for_servers_alone_and_carry_no_password(self, answer: MakeAnswer) -> None:
        uris = {
            "dance_yoga": "https://me:secret@host:5000/mlflow/",
            "face_yoga": "sqlite:////home/me/mlflow.db",
            "shark_yoga": "javascript:alert(1)",
            "face_pickup": "http://[",
            "walking_yoga": "javascript://host/%0aalert(1)",
        }
        table = build("table1", [answer(d, "ours", 0, run_id="a/b", uri=uri) for d, uri in uris.items()])
        links = [cell(table, d, "ours").runs[0].link for d in uris]
        assert links == ["https://host:5000/mlflow/#/runs/a%2Fb", "", "", "", ""]


class TestLiterature:
    def test_other_papers_numbers_stand_beside_without_a_verdict(self, table2_answers: Answers) -> None:
        table = build("table2", table2_answers)
        assert table.literature is not None
        rows = dict(table.literature.rows)
        assert rows["Dance + Yoga"] == ("0.078", "0.052", "0.043")
        assert rows["Mean"][2] == "0.0384"
        assert table.published == 48  # the paper's own numbers alone are judged
        for ending, render in writers.FORMATS.items():
            assert ("Zhu et al. 2014" in render(table)) == (ending in (".md", ".html", ".json")), ending

    def test_a_table_without_its_rows_has_none_of_their_numbers(self, answer: MakeAnswer) -> None:
        table = build("single_body", [answer("yoga", "bmm", None)])
        assert table.literature is not None
        labels = [label for label, _ in table.literature.rows]
        assert labels[-1] == "Mean" and "yoga" in labels
