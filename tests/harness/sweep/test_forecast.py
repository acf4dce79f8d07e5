"""What trials are going to take: from trials of the same size, or a power law through others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.environment import environment
from nrsfm.harness.record.folder import write_record
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.sweep.forecast import History, scaled, side_by_side, size_words, time_words

BLANK = Outcome("", "", "ok", "d", "ours", "known", "", "", 0.0, 0)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """With a tracker elsewhere, which keeps no files beside the trials'."""
    return Settings(tmp_path / "out", tmp_path, "http://host")


def leave(
    settings: Settings, key: str, frames: int, points: int, seconds: float, files: int = 0, **more: object
) -> None:
    """A record in its folder, with a file of so many bytes beside it."""
    given = {"seconds": seconds, "cpu_seconds": seconds / 2, "peak_mb": 100 * seconds, **more}
    folder = settings.trials / key
    write_record(folder, replace(BLANK, key=key, n_frames=frames, n_points=points, **given))
    if files:
        (folder / "arrays.npz").write_bytes(b"x" * files)


def trial(method: str = "ours", cameras: str = "known") -> Trial:
    return Trial({"name": "d"}, {"name": method}, {"source": cameras}, {"level": 0, "repeat": 0})


def history(settings: Settings) -> History:
    return History(settings, {"ours", "edsc"})


def test_a_power_law_is_found_by_three_sizes() -> None:
    known = {size: 2e-6 * size**1.7 for size in (1000, 4000, 9000)}
    assert scaled(known, 50_000) == pytest.approx(2e-6 * 50_000**1.7)
    assert scaled(known, 500) == pytest.approx(2e-6 * 500**1.7)


def test_the_nearest_size_is_where_it_starts() -> None:
    assert scaled({1000: 3.0, 50_000: 70.0}, 2000) == pytest.approx(6.0)  # two sizes: in proportion
    assert scaled({1000: 3.0, 50_000: 70.0}, 40_000) == pytest.approx(56.0)
    assert scaled({1000: 3.0, 2000: 2.0, 3000: 1.0}, 9000) == 1.0  # larger is not believed to be quicker
    assert scaled({1000: 1.0, 1001: 2.0, 1002: 4.0}, 2004) == pytest.approx(4 * 2**3.0)  # nor a cliff


def test_trials_of_the_same_size_say_it_by_their_median(settings: Settings) -> None:
    for i, seconds in enumerate((1.0, 2.0, 9.0)):
        leave(settings, f"same{i}", 100, 50, seconds)
    leave(settings, "larger", 50, 100, 30.0)  # as many frames x points, but another size
    leave(settings, "failed", 100, 50, 500.0, status="failed")
    leave(settings, "unlike", 100, 50, 500.0, method="edsc")
    (settings.trials / "broken").mkdir()
    (settings.trials / "broken/result.json").write_text("{")
    found = history(settings).forecast(trial(), (100, 50))
    assert (found.seconds, found.cpu_seconds, found.peak_mb) == (2.0, 1.0, 900.0)
    assert found.basis == "3 trials of this size"


def test_what_it_rests_on_is_told(settings: Settings) -> None:
    assert history(settings).forecast(trial(), (100, 50)) is None
    leave(settings, "a", 100, 50, 1.0)
    leave(settings, "b", 60, 116, 1.0)
    assert history(settings).forecast(trial(), (100, 60)).basis == "2 trials, 50 to 116 tracks, 60 to 100 frames"
    assert history(settings).forecast(trial("edsc"), (100, 50)) is None
    path = settings.trials / "a/result.json"
    path.write_text(path.read_text().replace(environment()["processor"], "Another"))
    assert history(settings).forecast(trial(), (100, 50)).basis == "1 trial of this size, on another processor"
    assert history(settings).forecast(trial(), (9, 9)).basis.endswith("frames, some on another processor")


def test_estimated_cameras_are_told_from_known_ones_where_both_were_before(settings: Settings) -> None:
    leave(settings, "known", 100, 50, 1.0)
    assert history(settings).forecast(trial(cameras="estimated"), (100, 50)).seconds == 1.0
    leave(settings, "estimated", 100, 50, 7.0, cameras="estimated")
    assert history(settings).forecast(trial(cameras="estimated"), (100, 50)).seconds == 7.0
    assert history(settings).forecast(trial(), (100, 50)).seconds == 1.0


def test_records_of_before_cpu_time_was_kept_count_one_core(settings: Settings) -> None:
    leave(settings, "old", 100, 50, 3.0, cpu_seconds=None)
    assert history(settings).forecast(trial(), (100, 50)).cpu_seconds == 3.0


def test_disk_is_what_the_files_take(settings: Settings, tmp_path: Path) -> None:
    """A tracker that is a SQLite file holds them once more, and its own share of that file."""
    leave(settings, "a", 100, 50, 1.0, files=2_000_000)
    once = history(settings).forecast(trial(), (100, 50)).disk_mb
    assert 2_000_000 / 2**20 <= once < 2_000_000 / 2**20 + 0.02
    store = tmp_path / "out/mlflow.db"
    store.write_bytes(b"x" * 2**20)
    local = replace(settings, tracking_uri=f"sqlite:///{store}")
    assert history(local).forecast(trial(), (100, 50)).disk_mb == pytest.approx(2 * once + 1)


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
