"""What a quick answer needs: modules that are not imported, files that are not read, processes that are not started."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import hydra
import pytest

from nrsfm.harness.config import jobs
from nrsfm.harness.config.spans import spanned
from nrsfm.harness.sweep import conductor
from nrsfm.harness.tracking import fresh_store, writer_process
from nrsfm.harness.tracking.tracker import Tracker
from tests.shell import ROOT, TINY, Shell


def loaded(code: str, *names: str) -> set[str]:
    """Those of the modules that are executed after some code, in a new process."""
    code += f"\nimport sys; print(*({set(names)} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["ron"], "did you mean run?"),
        (["run", "method=edcs"], "did you mean edsc?"),
        (["run", "-m", "method=ours,edcs"], "method 'edcs' is none of "),
        (["plan", "experiment=tabel1"], "did you mean table1?"),
        (["report", "tabel1"], "did you mean table1?"),
        (["solve", "none.npz", "--bodies", "2"], "none.npz is not there"),
        (["solve", "none.npz", "--bodies", "two"], "--bodies is 'two'"),
        (["solve", "none.npz", "--method", "edcs"], "did you mean edsc?"),
    ],
)
def test_an_error_loads_neither_hydra_nor_a_method(words: list[str], said: str) -> None:
    code = (
        "import sys; from nrsfm.harness.cli.main import main\n"
        f"code = main({words}); sys.stderr.flush()\n"
        "assert code in (2, 3), code"
    )
    heavy = ("hydra", "omegaconf", "yaml", "scipy", "sklearn", "pandas", "mlflow", "rich")
    assert loaded(code, *heavy) == set()
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert said in done.stderr


@pytest.mark.parametrize(
    ("word", "near"), [("noise.levl=1", "noise.level"), ("metod=ours", "method"), ("limit.seconds=3", "limits")]
)
def test_a_mistyped_key_is_told_the_nearest(nrsfm: Shell, word: str, near: str) -> None:
    done = nrsfm("plan", word)
    assert done.returncode == 3
    assert done.stderr.rstrip().endswith(f"; did you mean {near}?")


def test_methods_load_neither_pandas_nor_statistics() -> None:
    code = "from nrsfm.harness.record.imports import import_late; import_late(); import nrsfm.methods.registry"
    inside = ("pandas.core", "scipy.stats._stats_py", "sklearn.cluster")
    assert loaded(code, *inside) == set()
    used = f"{code}\nimport pandas, scipy.stats; assert pandas.Series([1, 3]).mean() == scipy.stats.tmean([1, 3])"
    assert loaded(used, *inside) == {"pandas.core", "scipy.stats._stats_py"}


@pytest.mark.parametrize(
    ("words", "most"),
    [
        (["experiment=tables"], 2),  # 8 scenes and 14 methods
        (["experiment=noise"], 2),
        (["experiment=table1", "dataset.frames=9", "method.name=own"], 2),
        (["method=ours,edsc", "cameras=known,estimated", "+method.how=a"], 3),  # what is added goes to each method
    ],
)
def test_choices_are_composed_together(monkeypatch: pytest.MonkeyPatch, words: list[str], most: int) -> None:
    composed = Mock(wraps=hydra.compose)
    monkeypatch.setattr(jobs, "compose", composed)
    each = spanned(words)
    found = list(jobs.plain_jobs(each))
    assert len(found) == len(each) > 3
    assert composed.call_count <= most


def test_what_is_done_starts_no_process(nrsfm: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    assert nrsfm("run", *TINY).returncode == 0

    def refuse() -> None:
        raise AssertionError("it was started")

    for module in (conductor, writer_process):
        monkeypatch.setattr(module, "prepare", refuse)
    monkeypatch.setattr(conductor, "start_server", refuse)
    done = nrsfm("run", *TINY)
    assert done.returncode == 0, done.stderr
    assert "nothing to run, 1 done before" in done.stdout


def test_sweeps_of_one_process_share_a_writer(nrsfm: Shell) -> None:
    assert nrsfm("run", *TINY).returncode == 0
    (idle,) = writer_process._IDLE
    assert nrsfm("run", *TINY, "noise.level=0.01").returncode == 0
    assert [idle] == writer_process._IDLE


def test_a_store_is_migrated_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    migrated = Mock(wraps=fresh_store._migrate)
    monkeypatch.setattr(fresh_store, "_migrate", migrated)
    for name in ("first.db", "second.db"):
        fresh_store.make_store(tmp_path / name)
    assert migrated.call_count == 1
    assert (tmp_path / "first.db").read_bytes() == (tmp_path / "second.db").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "first.db", "second.db"]


def test_a_store_is_made_without_a_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    fresh_store.make_store(tmp_path / "store.db")
    assert (tmp_path / "store.db").stat().st_size


def test_records_that_are_all_here_are_compared_without_the_tracker(
    nrsfm: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert nrsfm("run", *TINY).returncode == 0
    outcomes = Mock(wraps=Tracker.outcomes, return_value=[])
    monkeypatch.setattr(Tracker, "outcomes", outcomes)
    asked = ("compare", *TINY, "compare.against=published")
    assert "not run yet" not in nrsfm(*asked).stderr
    assert outcomes.call_count == 0
    assert "1 of 1 trials are not run yet" in nrsfm(*asked, "noise.level=0.5").stderr
    assert outcomes.call_count == 1
