"""Where the time of a trial goes whose method returns at once, part by part, in milliseconds of one core.

    pytest tests/benchmarks/test_trial_cost.py --override-ini addopts= --no-header -q

prints the table that docs and README quote; tests/benchmarks/test_sweep_overhead.py times whole sweeps.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock
from rich.table import Table

from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import expand
from nrsfm.harness.record import folder as storage
from nrsfm.harness.record.trial import Trial
from nrsfm.harness.tracking.tracker import Tracker
from nrsfm.harness.trial.execute import execute
from nrsfm.harness.trial.identity import identify
from nrsfm.harness.trial.isolation import run_isolated
from nrsfm.harness.trial.journal import Entry, note
from nrsfm.harness.trial.worker import compute
from tests.benchmarks.shown import show
from tests.shell import ODD, ROOT, naughty_package  # noqa: F401

TRIALS = 200
PARTS = {
    "composition": "configuration of the sweep into trials",
    "identity": "digest of the data, version of the method, key, record asked for",
    "process": "a process forked, limited, awaited, its group ended",
    "computation": "scene, method that returns at once, all metrics",
    "record": "arrays and record, each synced to disk",
    "lock and journal": "the trial's lock, a line for whoever follows",
    "tracker": "one MLflow run: parameters, metrics, tags, four artifacts",
}


@pytest.fixture
def sweep(
    tmp_path: Path,
    naughty_package: Path,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> Sequence[tuple[Trial, Settings]]:
    monkeypatch.syspath_prepend(naughty_package)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(naughty_package), str(ROOT / "src")]))
    monkeypatch.setenv("NRSFM_OUTPUT", str(tmp_path / "out"))
    monkeypatch.setenv("NRSFM_DATA", str(tmp_path / "no-data"))
    return expand(_words(TRIALS))


def test_where_the_time_of_a_trial_goes(
    sweep: list[tuple[Trial, Settings]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cost = dict.fromkeys(PARTS, 0.0)
    trials, (first, settings) = [trial for trial, _ in sweep], sweep[0]
    settings = replace(settings, sweep="cost")
    cost["composition"] = min(_milliseconds(lambda: expand(_words(TRIALS))) for _ in range(3)) / TRIALS
    outcome, _ = execute(first, settings)  # the server starts once
    store = Tracker(settings.tracking_uri, settings.output)
    store.log(outcome, settings.trials / outcome.key)

    def each(what: Callable[[int], object]) -> float:
        return min(_milliseconds(partial(what, i)) for i in range(1, TRIALS, 4))

    def identity(i: int) -> None:
        storage.read_record(settings.trials / identify(trials[i], settings).key)

    def process(_: int) -> None:
        ended = run_isolated("os:getpid", (), seconds=60, memory_gb=8, threads=1, log=tmp_path / "log")
        assert ended.status == "ok"

    blanks = {i: replace(outcome, key=f"{i:016}") for i in range(1, TRIALS, 4)}
    made = {i: compute(trials[i], blank, tmp_path, False) for i, blank in blanks.items()}

    def record(i: int) -> None:
        outcome, arrays = made[i]
        folder = settings.trials / outcome.key
        storage.write_atomically(folder / storage.ARRAYS, lambda handle: np.savez_compressed(handle, **arrays))
        storage.write_record(folder, outcome)

    def lock_and_journal(i: int) -> None:
        with FileLock(settings.trials / f"{i:016}" / ".lock"):
            note(settings, Entry(f"{i:016}", trials[i].title, "ok", True))

    def tracker(i: int) -> None:
        folder = settings.trials / f"{i:016}"
        written = storage.read_record(folder)
        assert written is not None
        store.log(written, folder)

    cost["identity"] = each(identity)
    cost["process"] = each(process)
    cost["computation"] = each(lambda i: compute(trials[i], blanks[i], tmp_path, False))
    cost["record"] = each(record)
    cost["lock and journal"] = each(lock_and_journal)
    cost["tracker"] = each(tracker)

    table = Table("part", "what it is", "ms a trial", title="What a trial costs beside its method")
    for part, words in PARTS.items():
        table.add_row(part, words, f"{cost[part]:.1f}")
    table.add_row("all", "", f"{sum(cost.values()):.1f}")
    show(capsys, table, f"least of {len(made)} trials each")
    assert len(store.outcomes()) == len(made) + 1
    assert all(value > 0 for value in cost.values())


def _words(n_trials: int) -> list[str]:
    return [*ODD, "+method.how=ok", "noise.level=0.01", f"noise.repeat=range({n_trials})"]


def _milliseconds(what: Callable[[], object]) -> float:
    start = time.perf_counter()
    what()
    return 1000 * (time.perf_counter() - start)
