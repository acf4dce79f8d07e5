"""Forecasts from past trials of the same method and size."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.environment import environment
from nrsfm.harness.record.folder import write_record
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.sweep.forecast import Forecast, History, side_by_side, size_words, time_words

BLANK = Outcome("", "", "ok", "d", "adaptive", "known", "", "", 0.0, 0)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """Settings with a tracking server, which keeps no files in the output folder."""
    return Settings(tmp_path / "out", tmp_path, "http://host")


def leave(settings: Settings, frames: int, points: int, seconds: float, **changes: Any) -> Path:
    """Write the record of a trial; returns its folder."""
    key = f"t{len(list(settings.trials.glob('*')))}"
    size = {"n_frames": frames, "n_points": points}
    took = {"seconds": seconds, "cpu_seconds": seconds / 2, "peak_mb": 100 * seconds}
    folder = settings.trials / key
    write_record(folder, replace(BLANK, key=key, **{**size, **took, **changes}))
    return folder


def trial(method: str = "adaptive", cameras: str = "known") -> Trial:
    return Trial({"name": "d"}, {"name": method}, {"source": cameras}, {"level": 0, "repeat": 0})


def history(settings: Settings) -> History:
    return History(settings, {"adaptive", "edsc"})


def forecast(settings: Settings, of: Trial | None = None, size: tuple[int, int] = (100, 50)) -> Forecast:
    expected = history(settings).forecast(of or trial(), size)
    assert expected is not None
    return expected


def test_the_median_of_trials_of_the_same_size(settings: Settings) -> None:
    for seconds in (1.0, 2.0, 9.0):
        leave(settings, 100, 50, seconds)
    leave(settings, 50, 100, 30.0)  # as many frames x points, but another size
    leave(settings, 100, 50, 500.0, status="failed")
    leave(settings, 100, 50, 500.0, method="edsc")
    (settings.trials / "broken").mkdir()
    (settings.trials / "broken/result.json").write_text("{")
    expected = forecast(settings)
    assert (expected.seconds, expected.cpu_seconds, expected.peak_mb) == (2.0, 1.0, 900.0)
    assert expected.basis == "3 trials of this size"


def test_another_size_is_named_and_not_scaled(settings: Settings) -> None:
    assert history(settings).forecast(trial(), (100, 50)) is None
    assert history(settings).unknown(trial(), (100, 50)) == "no past trial of this method"
    leave(settings, 100, 50, 12.0)
    leave(settings, 60, 116, 300.0)
    assert history(settings).forecast(trial(), (100, 52)) is None
    near, far = (history(settings).unknown(trial(), size) for size in ((100, 52), (200, 200)))
    assert near == "no past trial of this size; 50 tracks, 100 frames took 12 s"
    assert far == "no past trial of this size; 116 tracks, 60 frames took 5.0 min"
    assert history(settings).unknown(trial("edsc"), (100, 50)) == "no past trial of this method"


def test_trials_of_another_processor_are_named(settings: Settings) -> None:
    path = leave(settings, 100, 50, 1.0) / "result.json"
    path.write_text(path.read_text().replace(environment()["processor"], "Another"))
    assert forecast(settings).basis == "1 trial of this size, on another processor"
    leave(settings, 100, 50, 1.0)
    assert forecast(settings).basis == "2 trials of this size, some on another processor"


def test_trials_with_the_same_source_of_cameras_are_preferred(settings: Settings) -> None:
    leave(settings, 100, 50, 1.0)
    assert forecast(settings, trial(cameras="estimated")).seconds == 1.0
    leave(settings, 100, 50, 7.0, cameras="estimated")
    assert forecast(settings, trial(cameras="estimated")).seconds == 7.0
    assert forecast(settings).seconds == 1.0


def test_records_without_cpu_time_count_one_core(settings: Settings) -> None:
    leave(settings, 100, 50, 3.0, cpu_seconds=None)
    assert forecast(settings).cpu_seconds == 3.0


def test_disk_is_what_the_files_take(settings: Settings, tmp_path: Path) -> None:
    """A tracker that is a SQLite file holds copies of them, and a share of that file counts."""
    (leave(settings, 100, 50, 1.0) / "arrays.npz").write_bytes(b"x" * 2_000_000)
    once = forecast(settings).disk_mb
    assert 2_000_000 / 2**20 <= once < 2_000_000 / 2**20 + 0.02
    store = tmp_path / "out/mlflow.db"
    store.write_bytes(b"x" * 2**20)
    local = replace(settings, tracking_uri=f"sqlite:///{store}")
    assert forecast(local).disk_mb == pytest.approx(2 * once + 1)


def test_workers_take_the_next_trial_when_they_are_free() -> None:
    assert side_by_side([4, 1, 1, 1, 1], 2) == 4
    assert side_by_side([1, 1, 1, 1, 4], 2) == 6
    assert side_by_side([1, 2, 3], 1) == 6
    assert side_by_side([], 3) == 0


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.0, "0 s"), (0.123, "0.12 s"), (9.87, "9.9 s"), (61.2, "61 s"), (600, "10.0 min"), (9000, "2.5 h")],
)
def test_time_words(seconds: float, words: str) -> None:
    assert time_words(seconds) == words


@pytest.mark.parametrize(("mb", "words"), [(0.25, "0.25 MB"), (353.6, "354 MB"), (1023, "1023 MB"), (2048, "2.0 GB")])
def test_size_words(mb: float, words: str) -> None:
    assert size_words(mb) == words
