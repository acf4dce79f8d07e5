"""The page holds everything that it shows, once, and lets no foreign text out of its place."""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
from markupsafe import escape
from numpy.typing import NDArray

from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.metric_type import needed
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.tracked import Tracked
from nrsfm.reports.figures.page_data import Blobs
from nrsfm.reports.page.runs import BUDGET, FRAMES, details
from nrsfm.reports.page.standalone import plotly, script_json
from nrsfm.reports.report import Report
from tests.reports.conftest import make_answer


@pytest.fixture
def arrays(small_scene: Scene) -> dict[str, NDArray[Any]]:
    """What a run on the small scene left: two wrong tracks, a structure a little off."""
    truth, true_labels = needed(small_scene.structure), needed(small_scene.labels)
    labels = 1 - true_labels
    labels[[0, 20]] = 1 - labels[[0, 20]]
    return {
        "tracks": small_scene.tracks,
        "structure": 1.02 * truth,
        "true_structure": truth,
        "labels": labels,
        "true_labels": true_labels,
        "affinity": np.abs(np.subtract.outer(labels, labels)) + 0.1,
        "frame_e_3d": np.linspace(0.01, 0.05, len(small_scene.tracks)),
        "history_objective": np.exp(-np.arange(300.0)),
        "history_shape": np.exp(-np.arange(300.0)),
    }


def tracked(name: str, method: str = "ours", **more: Any) -> Tracked:
    return make_answer(name, method, 2, e_3d=0.03, e_3d_dai=0.04, n_points=30, **more)[1]


def unpack(blob: dict[str, Any]) -> NDArray[Any]:
    stored = np.frombuffer(zlib.decompress(base64.b64decode(blob["data"])), np.uint8)
    if blob["kind"] == "uint8":
        return np.asarray(stored.reshape(blob["shape"]) * blob["scale"])
    low, high = stored.reshape(2, -1).astype(np.uint16)
    steps = (256 * high + low).view(np.int16).reshape(blob["shape"])
    return np.asarray(np.cumsum(steps, axis=0, dtype=np.int16) * blob["scale"])


def embedded(text: str) -> dict[str, Any]:
    """The data of a page."""
    found = re.search(r'<script type="application/json" id="nrsfm-data">(.*?)</script>', text, re.DOTALL)
    assert found
    data: dict[str, Any] = json.loads(found[1])
    return data


class TestBlobs:
    @pytest.mark.parametrize("kind", ["int16", "uint8"])
    def test_round_trip_to_half_a_step(self, rng: np.random.Generator, kind: Literal["int16", "uint8"]) -> None:
        values = rng.uniform(0 if kind == "uint8" else -3, 3, (5, 3, 7))
        blobs = Blobs()
        blob = blobs.held[blobs.add(values, kind)]
        assert np.abs(unpack(blob) - values).max() <= 0.51 * blob["scale"] + 1e-5

    def test_the_same_array_travels_once(self, rng: np.random.Generator) -> None:
        blobs, values = Blobs(), rng.standard_normal((4, 3, 5))
        assert blobs.add(values, "int16") == blobs.add(values.copy(), "int16")
        assert blobs.add(2 * values, "int16") != blobs.add(values, "int16")
        assert len(blobs.held) == 2

    def test_zeros(self) -> None:
        blobs = Blobs()
        assert (unpack(blobs.held[blobs.add(np.zeros((2, 2)), "uint8")]) == 0).all()


class TestDetails:
    def test_a_run_tells_everything_and_plays(self, arrays: dict[str, NDArray[Any]]) -> None:
        run = tracked("dance_yoga")
        told, blobs = details([run], lambda _: arrays, [run.outcome.key])
        entry = told[run.outcome.key]
        assert entry["metrics"]["e_3d"] == 0.03
        view = entry["view"]
        truth = arrays["true_structure"] - arrays["true_structure"].mean(axis=2, keepdims=True)
        np.testing.assert_allclose(unpack(blobs.held[view["truth"]]), truth[:: view["step"]], atol=1e-3)
        assert view["wrong"] == [0, 20]
        assert [view["labels"][i] for i in (1, 21)] == [0, 1]
        assert len(entry["curves"]["residual_shape"]["x"]) == 100
        assert entry["frames"][-1] == 0.05

    def test_estimated_cameras_are_shown_after_their_alignment(self, arrays: dict[str, NDArray[Any]]) -> None:
        turn = np.diag([-1.0, -1.0, 1.0])
        turned = arrays | {"structure": turn @ arrays["structure"], "alignment": turn}
        run = tracked("dance_yoga")
        found = [details([run], fetch, [run.outcome.key]) for fetch in (lambda _: arrays, lambda _: turned)]
        first, second = (unpack(b.held[told[run.outcome.key]["view"]["found"]]) for told, b in found)
        np.testing.assert_allclose(first, second, atol=1e-6)

    def test_runs_that_are_not_viewed_have_no_arrays(self, arrays: dict[str, NDArray[Any]]) -> None:
        run = tracked("dance_yoga")
        told, blobs = details([run], lambda _: arrays, [])
        assert "view" not in told[run.outcome.key]
        assert not blobs.held

    def test_many_and_large_runs_keep_to_the_budget(self) -> None:
        rng = np.random.default_rng(0)
        runs = [tracked(f"scene{i}") for i in range(12)]
        runs = [replace(run, outcome=replace(run.outcome, n_points=5000)) for run in runs]
        large = {run.outcome.key: rng.standard_normal((150, 3, 5000)).astype(np.float32) for run in runs}

        def fetch(run: Tracked) -> dict[str, NDArray[Any]]:
            X = large[run.outcome.key]
            return {"structure": X, "true_structure": X}

        told, blobs = details(runs, fetch, list(large))
        views = [entry["view"] for entry in told.values()]
        assert all(blobs.held[view["truth"]]["shape"][0] <= FRAMES for view in views)
        assert sum(2 * np.prod(blob["shape"]) for blob in blobs.held.values()) <= BUDGET


class TestPage:
    def test_it_loads_nothing_and_names_every_run(
        self, table1_answers: list[Any], table2_answers: list[Any], arrays: dict[str, NDArray[Any]]
    ) -> None:
        report = Report({"table1": table1_answers, "table2": table2_answers}, lambda _: arrays)
        text = report.texts()["index.html"]
        assert text == Report(report.answers, lambda _: arrays).texts()["index.html"]
        markup = text.replace(plotly(), "")
        assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//|@import|url\(""", markup)
        assert "default-src 'none'" in markup
        data = embedded(text)
        assert data["runs"].keys() == report.runs.keys()
        opened = {key for keys in re.findall(r'data-runs="([^"]*)"', markup) for key in keys.split()}
        assert opened == report.runs.keys()

    def test_summary_first(self, table1_answers: list[Any]) -> None:
        report = Report({"table1": table1_answers})
        text = report.texts()["index.html"]
        sentences = [str(escape(sentence)) for sentence in report.answer]
        assert len(sentences) == 3
        for said in ("1607.04515", *sentences):
            assert text.index(said) < text.index('id="claims"') < text.index('id="table1"')

    def test_the_scene_of_the_paper_s_method_is_pictured(
        self, answer: Callable[..., Any], arrays: dict[str, NDArray[Any]]
    ) -> None:
        two = [answer("dance_yoga", method, 2, e_3d=0.03, n_points=30) for method in ("ssc2d", "ours")]
        for answers, fetch, pictured in ((two, lambda _: arrays, True), (two[:1], lambda _: arrays, False)):
            text = Report({"table1": answers}, fetch).texts()["index.html"]
            found = re.search(r'<img src="data:image/png;base64,([^"]*)".*?<figcaption>([^:]*)', text, re.DOTALL)
            assert (found is not None) == pictured
            if found:
                assert base64.b64decode(found[1]).startswith(b"\x89PNG")
                assert found[2] == "dance + yoga"
        assert "<img" not in Report({"table1": two}).texts()["index.html"].replace(plotly(), "")  # no arrays

    def test_no_text_leaves_the_data(self, answer: Callable[..., Any]) -> None:
        evil = "</script><script>alert(1)</script><!-- <b>&amp;"
        answers = [answer("dance_yoga", "ours", status="failed", error=evil, parameters={evil: evil})]
        text = Report({"table1": answers}).texts()["index.html"].replace(plotly(), "")
        assert "alert(1)</script>" not in text
        assert text.count("</script>") == 3  # data, library, program
        (run,) = embedded(text)["runs"].values()
        assert run["error"] == evil

    def test_json_in_a_script_is_json(self) -> None:
        value = {"a": ["</script>", "<!--", "&", "\u2028"], "b": 1.5}
        text = script_json(value)
        assert json.loads(text) == value
        assert not {"<", ">", "\u2028"} & set(text)
        with pytest.raises(ValueError, match="JSON"):
            script_json({"a": float("nan")})


def test_settings_are_shown_as_they_are_written() -> None:
    run = tracked("dance_yoga")
    outcome: Outcome = replace(
        run.outcome, parameters={"method": {"period": None, "exact": True, "bodies": ["a", "b"]}}
    )
    told, _ = details([replace(run, outcome=outcome)], lambda _: {}, [])
    assert told[outcome.key]["parameters"] == {
        "method.bodies": '["a", "b"]',
        "method.exact": "true",
        "method.period": "null",
    }
