"""Baseline files and comparisons: changed rows are named, and the exit code says what is wrong."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from rich.console import Console

from nrsfm.harness.gate.baseline import Baseline, bless
from nrsfm.harness.gate.comparison import Comparison, Gate, State, compare
from nrsfm.harness.gate.formats import as_json, junit, markdown, show
from nrsfm.harness.gate.schema import LARGEST_REASON
from nrsfm.harness.gate.tolerance import Tolerance, tolerances
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.outcome import Outcome
from nrsfm.reports.layouts.baseline import published

DAY = "2024-05-01"


def outcome(dataset: str = "dance_yoga", method: str = "adaptive", **more: Any) -> Outcome:
    """A finished trial with 3 of 116 tracks wrong."""
    metrics = {"e_ms": 3 / 116, "n_wrong": 3.0, "e_3d": 0.025, "e_3d_dai": 0.0456, "e_r": 0.01, "e_3d_body_0": 0.02}
    fields: dict[str, Any] = {
        "key": f"{dataset}-{method}-{more.get('level', 0)}-{more.get('repeat', 0)}-{more.get('stand_in', False)}",
        "setting": "s",
        "status": "ok",
        "cameras": "known",
        "placement": "paper",
        "motion": "registered",
        "level": 0.0,
        "repeat": 0,
        "n_points": 116,
        "metrics": metrics,
    } | more
    if fields["status"] != "ok":
        fields |= {"metrics": {}, "n_points": None}
    return Outcome(dataset=dataset, method=method, **fields)


def changed(one: Outcome, **metrics: float) -> Outcome:
    return replace(one, metrics=one.metrics | metrics)


@pytest.fixture
def measured() -> list[Outcome]:
    return [outcome(), outcome(method="edsc"), outcome("face_yoga", n_points=81), outcome(level=0.02, repeat=1)]


@pytest.fixture
def blessed(measured: list[Outcome], tmp_path: Path) -> Path:
    path = tmp_path / "quick.json"
    bless(measured, path, "first numbers", DAY)
    return path


Change = Callable[[Any], None]
"""Changes the data of a baseline file in place."""


def tampered(path: Path, change: Change) -> Path:
    """The file with its data changed in place."""
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    return path


def printed(comparison: Comparison) -> str:
    out = io.StringIO()
    show(comparison, Console(file=out))
    return out.getvalue()


class TestExitCodes:
    def test_the_true_baseline_passes(self, blessed: Path, measured: list[Outcome]) -> None:
        found = compare(Baseline.read(blessed), measured)
        assert found.code == 0
        assert {line.state for line in found.lines} == {State.PASS}
        assert {line.metric for line in found.lines} == {"n_wrong", "e_3d", "e_3d_dai"}

    @pytest.mark.parametrize(("metric", "value"), [("n_wrong", 1), ("e_3d", 0.02), ("e_3d_dai", 0.04)])
    def test_a_tampered_row_is_named(self, blessed: Path, measured: list[Outcome], metric: str, value: float) -> None:
        def lower(data: Any) -> None:
            wanted = ("dance_yoga", "edsc", metric)
            (cell,) = [r for r in data["rows"] if (r["dataset"], r["method"], r["metric"]) == wanted]
            cell["value"] = value

        found = compare(Baseline.read(tampered(blessed, lower)), measured)
        assert found.code == 1
        assert [(line.metric, line.state) for line in found.bad] == [(metric, State.REGRESSED)]
        assert "dance_yoga edsc (cameras known" in printed(found)

    def test_missing_rows_and_metrics(self, blessed: Path, measured: list[Outcome]) -> None:
        assert compare(Baseline.read(blessed), measured[1:]).code == 2
        short = replace(measured[0], metrics={"e_3d": 0.025, "n_wrong": 3.0, "e_r": 0.01})
        found = compare(Baseline.read(blessed), [short, *measured[1:]])
        assert found.code == 2
        assert [(line.metric, line.why) for line in found.bad] == [("e_3d_dai", "no longer logged")]

    def test_a_metric_without_tolerance_must_still_be_there(self, blessed: Path, measured: list[Outcome]) -> None:
        short = replace(measured[0], metrics={k: v for k, v in measured[0].metrics.items() if k != "e_r"})
        assert compare(Baseline.read(blessed), [short, *measured[1:]]).code == 2
        wild = [changed(measured[0], e_r=9.0), *measured[1:]]
        assert compare(Baseline.read(blessed), wild).code == 0

    @pytest.mark.parametrize("status", ["failed", "crashed", "timeout", "oom"])
    def test_failed(self, blessed: Path, measured: list[Outcome], status: str) -> None:
        found = compare(Baseline.read(blessed), [outcome(status=status, error="no [bold]good\nat all"), *measured[1:]])
        assert found.code == 2
        assert f"{status}: no [bold]good at all" in printed(found)

    def test_missing_wins_over_worse(self, blessed: Path, measured: list[Outcome]) -> None:
        assert compare(Baseline.read(blessed), [changed(measured[0], e_3d=1.0)]).code == 2

    def test_better_and_new_pass(self, blessed: Path, measured: list[Outcome]) -> None:
        found = compare(
            Baseline.read(blessed), [changed(measured[0], e_3d=0.01), *measured[1:], outcome(method="newcomer")]
        )
        assert (found.code, found.counts[State.IMPROVED], found.counts[State.NEW]) == (0, 1, 1)

    def test_a_new_row_that_failed_does_not_pass(self, blessed: Path, measured: list[Outcome]) -> None:
        assert compare(Baseline.read(blessed), [*measured, outcome(method="newcomer", status="failed")]).code == 2

    def test_a_blessed_failure_stays_or_gets_better(self, tmp_path: Path, measured: list[Outcome]) -> None:
        path = tmp_path / "b.json"
        failed = outcome(method="edsc", status="timeout")
        bless([measured[0], failed], path, "edsc cannot do it yet", DAY)
        assert compare(Baseline.read(path), [measured[0], failed]).code == 0
        found = compare(Baseline.read(path), measured[:2])
        assert (found.code, found.counts[State.IMPROVED]) == (0, 1)

    def test_nothing_measured(self, blessed: Path) -> None:
        assert compare(Baseline.read(blessed), []).code == 2

    def test_another_number_of_tracks_is_another_scene(self, blessed: Path, measured: list[Outcome]) -> None:
        found = compare(Baseline.read(blessed), [replace(measured[0], n_points=90), *measured[1:]])
        assert found.code == 2
        assert "116 tracks, 90 were measured" in printed(found)


class TestTolerance:
    # .025: the larger of .002 and 5 % is .002; 1.0: it is .05
    @pytest.mark.parametrize(
        ("base", "value", "state"),
        [
            (0.025, 0.027, "pass"),
            (0.025, 0.0271, "regressed"),
            (0.025, 0.023, "pass"),
            (0.025, 0.0229, "improved"),
            (1.0, 1.05, "pass"),
            (1.0, 1.051, "regressed"),
        ],
    )
    def test_the_larger_of_absolute_and_relative(self, tmp_path: Path, base: float, value: float, state: str) -> None:
        path = tmp_path / "b.json"
        bless([changed(outcome(), e_3d=base)], path, "why", DAY)
        found = compare(Baseline.read(path), [changed(outcome(), e_3d=value)], {"e_3d": Tolerance(0.002, 0.05)})
        assert [line.state for line in found.lines if line.metric == "e_3d"] == [state]

    @pytest.mark.parametrize(("wrong", "state"), [(1, "improved"), (2, "pass"), (4, "pass"), (5, "regressed")])
    def test_segmentation_in_tracks(self, blessed: Path, measured: list[Outcome], wrong: int, state: str) -> None:
        chosen = tolerances({"e_ms": {"tracks": 1}})
        found = compare(Baseline.read(blessed), [changed(measured[0], n_wrong=wrong), *measured[1:]], chosen)
        row = [line for line in found.lines if line.row.startswith("dance_yoga adaptive") and "noise" not in line.row]
        assert [(line.metric, line.state) for line in row] == [("n_wrong", state)]

    def test_numbers_that_need_more_digits_than_are_kept_are_still_the_same(self, tmp_path: Path) -> None:
        path = tmp_path / "b.json"
        one = changed(outcome(), e_3d=0.1 / 3, e_3d_dai=2 / 3e5)
        bless([one], path, "why", DAY)
        assert compare(Baseline.read(path), [one], {"*": Tolerance()}).code == 0

    def test_exact_names_win_over_patterns(self, blessed: Path, measured: list[Outcome]) -> None:
        worse = [changed(measured[0], e_3d=0.03, e_3d_dai=0.05), *measured[1:]]
        chosen = {"e_3d*": Tolerance(), "e_3d": Tolerance(absolute=1)}
        assert [line.metric for line in compare(Baseline.read(blessed), worse, chosen).bad] == ["e_3d_dai"]

    @pytest.mark.parametrize(
        "config",
        [
            {"e_ms": {"absolute": 1}},
            {"e_3d": {"tracks": 1}},
            {"e_3d": {}},
            {"e_3d": 0.1},
            {"e_3d": {"absolute": -1}},
            {"e_3d": {"absolute": "0.1"}},
            {"e_3d": {"relative": True}},
            {"e_3d": {"relative": float("nan")}},
        ],
    )
    def test_bad_configuration(self, config: dict[str, Any]) -> None:
        with pytest.raises(UsageError, match="tolerance of e_"):
            tolerances(config)


class TestStandIns:
    @pytest.mark.parametrize("stand_in", [False, True])
    def test_never_against_the_other_kind(self, tmp_path: Path, stand_in: bool) -> None:
        path = tmp_path / "b.json"
        bless([outcome(stand_in=stand_in)], path, "why", DAY)
        found = compare(Baseline.read(path), [outcome(stand_in=not stand_in)])
        assert found.code == 2
        assert "they do not compare" in printed(found)
        assert compare(Baseline.read(path), [outcome(stand_in=stand_in)]).code == 0

    def test_both_kinds_may_stand_side_by_side(self, tmp_path: Path) -> None:
        path = tmp_path / "b.json"
        both = [outcome(), changed(outcome(stand_in=True), e_3d=0.5)]
        bless(both, path, "why", DAY)
        assert compare(Baseline.read(path), both[::-1]).code == 0

    def test_a_failure_that_does_not_know_its_data_is_a_failure(self, tmp_path: Path) -> None:
        path = tmp_path / "b.json"
        bless([outcome(stand_in=True)], path, "why", DAY)
        found = compare(Baseline.read(path), [outcome(status="crashed")])
        assert [line.state for line in found.lines] == [State.FAILED]


def against_published(outcomes: list[Outcome]) -> Comparison:
    return compare(published(outcomes), outcomes, against="published")


class TestPublished:
    def test_the_papers_numbers_by_the_same_rule(self) -> None:
        good = outcome(method="bmm_ssc3d", metrics={"n_wrong": 4.0, "e_3d_dai": 0.05, "e_3d": 9.0})
        found = against_published([good])
        assert found.code == 0
        assert {line.metric: line.baseline for line in found.lines} == {"e_3d_dai": 0.0456, "n_wrong": 4}
        assert against_published([changed(good, e_3d_dai=0.0502)]).code == 1
        assert against_published([changed(good, n_wrong=6.0)]).code == 1

    def test_without_a_published_number_there_is_no_line(self) -> None:
        outs = [outcome(method="newcomer"), outcome("drink_stretch"), outcome(level=0.02)]
        found = against_published(outs)
        assert (found.lines, found.code) == ((), 2)
        assert "nothing to compare" in found.summary
        good = outcome(method="ssc2d", metrics={"n_wrong": 3.0})
        assert against_published([*outs, good]).code == 0

    def test_real_data_alone(self) -> None:
        found = against_published([outcome(method="ssc2d", stand_in=True)])
        assert found.code == 2
        assert "real data, the measurement from a stand-in" in printed(found)

    def test_failures_and_other_scenes(self) -> None:
        assert against_published([outcome(method="ssc2d", status="failed")]).code == 2
        assert "not the same scene" in printed(against_published([outcome(method="ssc2d", n_points=90)]))

    def test_tracks_are_counted(self) -> None:
        (row,) = published([outcome("shark_yoga", "ssc2d", n_points=132)]).rows
        assert row.metrics == {"n_wrong": 54}

    def test_unknown_words(self, blessed: Path) -> None:
        with pytest.raises(UsageError, match="'best'"):
            compare(Baseline.read(blessed), [], against="best")


class TestBless:
    def test_deterministic_sorted_and_rounded(self, tmp_path: Path, measured: list[Outcome]) -> None:
        first, second = tmp_path / "a.json", tmp_path / "b.json"
        exact = [changed(o, e_3d=1 / 3) for o in measured]
        bless(exact, first, "why", DAY)
        bless(exact[::-1], second, "why", DAY)
        assert first.read_bytes() == second.read_bytes()
        data = json.loads(first.read_text())
        assert data["rows"][0]["metric"] == "e_3d"
        assert data["rows"][0]["value"] == 0.333333
        assert [r["dataset"] for r in data["rows"]] == ["dance_yoga"] * 12 + ["face_yoga"] * 4
        assert "e_3d_body_0" not in {r["metric"] for r in data["rows"]}
        lines = first.read_text().splitlines()
        assert sum('"metric": "n_wrong"' in line for line in lines) == 4  # a cell a line

    def test_gaps_make_rows_of_their_own(self, tmp_path: Path) -> None:
        gaps = [{"gaps": {"kind": kind, "share": share}} for kind in ("random", "stretches") for share in (0.1, 0.2)]
        runs = [outcome(key=str(i), parameters=parameters) for i, parameters in enumerate([{}, *gaps])]
        path = tmp_path / "b.json"
        bless(runs, path, "with gaps", DAY)
        said = {row.title for row in Baseline.read(path).rows}
        assert len(said) == 5
        assert any("gaps stretches 0.2" in title for title in said)

    def test_draws_are_one_cell_with_their_spread(self, tmp_path: Path) -> None:
        draws = [changed(outcome(level=0.02, repeat=r), e_3d=0.02 + r / 100) for r in range(3)]
        (row,) = bless(draws, tmp_path / "b.json", "why", DAY).rows
        assert row.metrics["e_3d"] == pytest.approx(0.03)
        assert row.spreads["e_3d"] == pytest.approx(0.01)
        assert row.trials == tuple(sorted(o.key for o in draws))
        assert Baseline.read(tmp_path / "b.json").rows == (row,)
        found = compare(Baseline.read(tmp_path / "b.json"), draws[1:])
        assert found.code == 2
        assert "over 3 draws, 2 were measured" in printed(found)
        failed = [*draws[1:], outcome(level=0.02, repeat=0, status="oom", error="too large")]
        found = compare(Baseline.read(tmp_path / "b.json"), failed)
        assert [line.state for line in found.lines] == [State.FAILED]

    def test_spread_widens_what_is_allowed_if_asked(self, tmp_path: Path) -> None:
        draws = [changed(outcome(level=0.02, repeat=r), e_3d=0.02 + r / 100) for r in range(3)]
        baseline = bless(draws, tmp_path / "b.json", "why", DAY)
        worse = [changed(o, e_3d=o.metrics["e_3d"] + 0.015) for o in draws]
        assert compare(baseline, worse, tolerances({"e_3d": {"spreads": 2}})).code == 0
        assert compare(baseline, worse, tolerances({"e_3d": {"spreads": 1}})).code == 1

    def test_reasons_become_history(self, blessed: Path, measured: list[Outcome]) -> None:
        bless(measured[:1], blessed, "  second\n reason ", "2024-06-01")
        bless(measured[:2], blessed, "third", "2024-07-01")
        found = Baseline.read(blessed)
        assert (found.reason, found.date, len(found.rows)) == ("third", "2024-07-01", 2)
        assert found.history == ((DAY, "first numbers"), ("2024-06-01", "second reason"))

    @pytest.mark.parametrize("reason", ["", "  ", "\n\t", "x" * (LARGEST_REASON + 1)])
    def test_a_reason_is_needed(self, tmp_path: Path, measured: list[Outcome], reason: str) -> None:
        with pytest.raises(UsageError, match="reason"):
            bless(measured, tmp_path / "b.json", reason, DAY)
        assert not (tmp_path / "b.json").exists()

    @pytest.mark.parametrize("date", ["", "yesterday", "2024-5-1", "2024-02-30", "20240501"])
    def test_a_date_is_needed(self, tmp_path: Path, measured: list[Outcome], date: str) -> None:
        with pytest.raises(UsageError, match="YYYY-MM-DD"):
            bless(measured, tmp_path / "b.json", "why", date)

    def test_nothing_or_two_of_one_row(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="nothing to bless"):
            bless([], tmp_path / "b.json", "why", DAY)
        with pytest.raises(UsageError, match=r"dance_yoga adaptive .* settings"):
            bless([outcome(), outcome(key="other")], tmp_path / "b.json", "why", DAY)

    def test_a_trial_that_two_tables_share_counts_once(self, tmp_path: Path) -> None:
        baseline = bless([outcome(), outcome()], tmp_path / "b.json", "why", DAY)
        assert len(baseline.rows) == 1
        assert compare(baseline, [outcome(), outcome()]).code == 0

    def test_a_damaged_file_is_not_overwritten(self, blessed: Path, measured: list[Outcome]) -> None:
        blessed.write_text("{")
        with pytest.raises(UsageError, match="not valid JSON"):
            bless(measured, blessed, "why", DAY)
        assert blessed.read_text() == "{"

    def test_what_could_not_be_read_again_is_not_written(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="dataset"):
            bless([outcome("dance\nyoga")], tmp_path / "b.json", "why", DAY)
        assert not (tmp_path / "b.json").exists()


def put(*path: str | int, value: Any) -> Change:
    """A change that sets one field."""

    def change(data: Any) -> None:
        for step in path[:-1]:
            data = data[step]
        data[path[-1]] = value

    return change


def drop(*path: str | int) -> Change:
    """A change that removes one field."""

    def change(data: Any) -> None:
        for step in path[:-1]:
            data = data[step]
        del data[path[-1]]

    return change


class TestUntrustedFiles:
    @pytest.mark.parametrize(
        ("change", "field"),
        [
            (drop("rows"), "rows"),
            (drop("reason"), "reason"),
            (put("schema", value=1), "schema"),
            (put("schema", value=True), "schema"),
            (put("date", value="soon"), "date"),
            (put("reason", value=""), "reason"),
            (put("extra", value=1), "extra"),
            (put("rows", value=[]), "rows"),
            (put("rows", value={}), "rows"),
            (put("rows", 1, value=3), r"rows\[1\]"),
            (put("history", value=[{"date": DAY}]), r"history\[0\].reason"),
            (put("rows", 1, "dataset", value=3), r"rows\[1\].dataset"),
            (put("rows", 1, "dataset", value="a\x1b[2Jb"), r"rows\[1\].dataset"),
            (put("rows", 1, "dataset", value="a" * 999), r"rows\[1\].dataset"),
            (put("rows", 1, "method", value=""), r"rows\[1\].method"),
            (put("rows", 1, "level", value="0"), r"rows\[1\].level"),
            (put("rows", 1, "level", value=-0.1), r"rows\[1\].level"),
            (put("rows", 1, "count", value=0.5), r"rows\[1\].count"),
            (put("rows", 1, "count", value=True), r"rows\[1\].count"),
            (put("rows", 1, "count", value=2), r"rows\[1\].count"),
            (put("rows", 1, "trials", value="k"), r"rows\[1\].trials"),
            (put("rows", 1, "trials", value=[3]), r"rows\[1\].trials\[0\]"),
            (put("rows", 1, "trials", value=["other"]), r"rows\[1\] dance_yoga .* not of the same trials"),
            (put("rows", 1, "stand_in", value=0), r"rows\[1\].stand_in"),
            (put("rows", 1, "status", value="fine"), r"rows\[1\].status"),
            (put("rows", 1, "status", value="failed"), r"rows\[1\].metric"),
            (drop("rows", 1, "metric"), r"rows\[1\].metric"),
            (put("rows", 1, "spread", value=-1), r"rows\[1\].spread"),
            (put("rows", 1, "n_points", value=-1), r"rows\[1\].n_points"),
            (put("rows", 1, "value", value=[]), r"rows\[1\].value"),
            (put("rows", 1, "value", value=None), r"rows\[1\].value"),
            (put("rows", 1, "value", value="0.1"), r"rows\[1\].value"),
            (put("rows", 1, "value", value=True), r"rows\[1\].value"),
            (put("rows", 1, "value", value=10**400), r"rows\[1\].value"),
            (put("rows", 3, "value", value=117), r"rows\[3\].value"),
            (put("rows", 1, "metric", value="a b"), r"rows\[1\].metric"),
            (put("rows", 1, "surprise", value=1), r"rows\[1\].surprise"),
            (drop("rows", 1, "value"), r"rows\[1\].value"),
            (lambda data: data["rows"].append(data["rows"][1]), r"rows\[16\] dance_yoga .* is there"),
        ],
    )
    def test_the_field_is_named(self, blessed: Path, change: Change, field: str) -> None:
        with pytest.raises(UsageError, match=rf"^{blessed}: {field} ") as caught:
            Baseline.read(tampered(blessed, change))
        assert "\n" not in str(caught.value)
        assert "\x1b" not in str(caught.value)

    @pytest.mark.parametrize(
        "raw",
        [
            b"",
            b"{",
            b"\xff\xfe\x00",
            b"[" * 100_000,
            b'{"schema": NaN}',
            b'{"schema": 1, "schema": 1}',
            b'{"schema": ' + b"9" * 5000 + b"}",
            b'"baseline"',
            b"[]",
        ],
    )
    def test_what_is_no_baseline(self, tmp_path: Path, raw: bytes) -> None:
        path = tmp_path / "b.json"
        path.write_bytes(raw)
        with pytest.raises(UsageError, match=r"b\.json"):
            Baseline.read(path)

    def test_numbers_that_json_does_not_have(self, blessed: Path) -> None:
        blessed.write_text(blessed.read_text().replace("0.025", "NaN", 1))
        with pytest.raises(UsageError, match="NaN is not a number"):
            Baseline.read(blessed)

    def test_missing_large_and_odd_files(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="is missing; make it with 'nrsfm bless'"):
            Baseline.read(tmp_path / "b.json")
        (tmp_path / "large.json").write_bytes(b" " * (5 << 20))
        with pytest.raises(UsageError, match="larger than 4 MiB"):
            Baseline.read(tmp_path / "large.json")
        with pytest.raises(UsageError):
            Baseline.read(tmp_path)
        os.mkfifo(tmp_path / "pipe")
        with pytest.raises(UsageError, match="not a regular file"):
            Baseline.read(tmp_path / "pipe")


class TestTelling:
    @pytest.fixture
    def comparison(self, blessed: Path, measured: list[Outcome]) -> Comparison:
        return compare(
            Baseline.read(blessed), [changed(measured[0], e_3d=0.5), outcome(method="a|b<script>"), *measured[2:]]
        )

    def test_plain_lines_name_each_bad_row(self, comparison: Comparison) -> None:
        lines = printed(comparison).splitlines()
        assert lines[-2].startswith("dance_yoga edsc (cameras known, placement paper, motion registered): missing")
        assert lines[-3].endswith("e_3d regressed: 0.025 -> 0.5, up to 0.027 allowed")
        assert lines[-1].startswith("Against the blessed baseline: ")
        assert "\x1b" not in printed(comparison)

    def test_markdown_has_a_row_a_line(self, comparison: Comparison) -> None:
        text = markdown(Gate((comparison,)))
        assert text.startswith("## Blocked\n")
        table = [line for line in text.splitlines() if line.startswith("|")]
        assert len(table) == 2 + len([line for line in comparison.lines if line.state is not State.PASS])
        assert {line.replace("\\|", "").count("|") for line in table} == {8}
        assert "<script" not in text
        assert "| regressed | 0.025 | 0.5 | 0.027 |" in text

    def test_a_clean_comparison_is_one_line(self, blessed: Path, measured: list[Outcome]) -> None:
        found = compare(Baseline.read(blessed), measured)
        assert printed(found) == "Against the blessed baseline: 12 pass.\n"
        assert markdown(Gate((found,))) == "## Passed\n\n**Against the blessed baseline: 12 pass.**\n"

    def test_junit_fails_what_blocks_and_skips_what_informs(self, comparison: Comparison) -> None:
        blocking, informing = (
            ElementTree.fromstring(junit(gate).encode()) for gate in (Gate((comparison,)), Gate((), (comparison,)))
        )
        assert len(blocking.findall("testsuite/testcase")) == len(comparison.lines)
        assert len(blocking.findall(".//failure")) == len(comparison.bad) == int(blocking[0].get("failures", ""))
        assert not informing.findall(".//failure")
        assert len(informing.findall(".//skipped")) >= len(comparison.bad)
        (regressed,) = [f for f in blocking.iter("failure") if "e_3d regressed" in f.get("message", "")]
        assert "up to 0.027 allowed" in regressed.get("message", "")

    def test_json_has_every_line(self, comparison: Comparison) -> None:
        data = json.loads(as_json(Gate((comparison,))))
        assert (data["code"], len(data["comparisons"][0]["lines"])) == (2, len(comparison.lines))
        (line,) = [line for line in data["comparisons"][0]["lines"] if line["state"] == "regressed"]
        assert (line["baseline"], line["measured"]) == (0.025, 0.5)
        assert line["allowed"] == pytest.approx(0.027)

    def test_only_what_blocks_decides(self, comparison: Comparison) -> None:
        assert Gate((), (comparison,)).code == 0
        assert Gate((comparison,)).code == 2

    def test_a_terminal_gets_a_table(self, comparison: Comparison) -> None:
        out = io.StringIO()
        show(comparison, Console(file=out, force_terminal=True, width=200))
        assert "Verdict" in out.getvalue()
        assert "\x1b[31mregressed" in out.getvalue()
