"""What a trial costs beside its method: a grid of trials that return at once, run by three harnesses.

Ours isolates every trial in a process under limits, keeps a record and logs to MLflow. The hand-written Hydra
application logs the same numbers to MLflow and isolates nothing; benchopt has neither isolation nor tracker.
``--benchmark-group-by=group`` puts them side by side; `extra_info` has the seconds a trial.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from tests.shell import ODD, naughty_package  # noqa: F401

TRIALS = 200
CORES = sorted(os.sched_getaffinity(0))[:2] if hasattr(os, "sched_getaffinity") else [0, 1]

#: A Hydra application as one writes it by hand, after Hydra's and MLflow's own tutorials.
BY_HAND = """
import hydra, mlflow
import numpy as np

@hydra.main(config_path=None, config_name="config", version_base="1.3")
def main(cfg):
    mlflow.set_tracking_uri(cfg.uri)
    mlflow.set_experiment("grid")
    rng = np.random.default_rng(cfg.noise.repeat)
    tracks = rng.standard_normal((12, 2, 16))
    with mlflow.start_run():
        mlflow.log_params({"method": cfg.method, "level": cfg.noise.level, "repeat": cfg.noise.repeat})
        labels = np.arange(tracks.shape[2]) % 2
        mlflow.log_metrics({"e_ms": float((labels != 0).mean()), "spread": float(tracks.std())})

if __name__ == "__main__":
    from hydra.core.config_store import ConfigStore
    ConfigStore.instance().store("config", {"uri": "", "method": "at_once", "noise": {"level": 0.01, "repeat": 0}})
    main()
"""

OBJECTIVE = """
from benchopt import BaseObjective

class Objective(BaseObjective):
    name = "grid"
    def set_data(self, tracks):
        self.tracks = tracks
    def evaluate_result(self, labels):
        return dict(value=float((labels != 0).mean()), spread=float(self.tracks.std()))
    def get_objective(self):
        return dict(tracks=self.tracks)
    def get_one_result(self):
        return dict(labels=self.tracks[0, 0])
"""

DATASET = """
import numpy as np
from benchopt import BaseDataset

class Dataset(BaseDataset):
    name = "noise"
    parameters = {"repeat": list(range(%d))}
    def get_data(self):
        return dict(tracks=np.random.default_rng(self.repeat).standard_normal((12, 2, 16)))
"""

SOLVER = """
import numpy as np
from benchopt import BaseSolver

class Solver(BaseSolver):
    name = "at_once"
    sampling_strategy = "run_once"
    def set_objective(self, tracks):
        self.tracks = tracks
    def run(self, _):
        self.labels = np.arange(self.tracks.shape[2]) %% 2
    def get_result(self):
        return dict(labels=self.labels)
"""


def measure(benchmark: BenchmarkFixture, command: list[str], cores: int, clean: Path, env: dict[str, str]) -> None:
    """Time a whole sweep from an empty folder, on so many cores."""
    benchmark.group = f"{TRIALS} trials that return at once"
    pinned = ["taskset", "--cpu-list", ",".join(map(str, CORES[:cores]))]

    def start() -> None:
        shutil.rmtree(clean, ignore_errors=True)
        clean.mkdir()

    def run() -> None:
        done = subprocess.run([*pinned, *command], env=env, cwd=clean, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr[-2000:]

    benchmark.pedantic(run, setup=start, rounds=3)  # type: ignore[no-untyped-call]
    assert benchmark.stats is not None
    benchmark.extra_info["seconds a trial"] = round(benchmark.stats.stats.min / TRIALS, 4)


@pytest.mark.parametrize("cores", [1, 2])
def test_ours(benchmark: BenchmarkFixture, tmp_path: Path, naughty_package: Path, cores: int) -> None:  # noqa: F811
    root = Path(__file__).parents[2]
    paths = os.pathsep.join([str(naughty_package), str(root / "src")])
    env = os.environ | {"NRSFM_OUTPUT": str(tmp_path / "out/outputs"), "PYTHONPATH": paths}
    words = [*ODD, "+method.how=ok", "noise.level=0.01", f"noise.repeat=range({TRIALS})"]
    measure(benchmark, [sys.executable, "-m", "nrsfm", "run", "-m", *words], cores, tmp_path / "out", env)


@pytest.mark.parametrize(("launcher", "cores"), [("basic", 1), ("joblib", 2)])
def test_hydra_and_mlflow_by_hand(benchmark: BenchmarkFixture, tmp_path: Path, launcher: str, cores: int) -> None:
    (tmp_path / "app.py").write_text(BY_HAND)
    out = tmp_path / "out"
    store = f"uri='sqlite:///{out}/mlflow.db'"
    env = os.environ | {"MLFLOW_DISABLE_TELEMETRY": "true", "GIT_PYTHON_REFRESH": "quiet"}
    # two workers that meet at a fresh store fail in its migrations, so it is made first
    command = f'{sys.executable} {tmp_path}/app.py "{store}" noise.repeat=0 hydra.run.dir={out}/first && '
    command += f'{sys.executable} {tmp_path}/app.py -m hydra/launcher={launcher} "{store}" '
    command += f"'noise.repeat=range(1,{TRIALS})' hydra.sweep.dir={out}/sweep"
    measure(benchmark, ["bash", "-c", command], cores, out, env)


def test_benchopt(benchmark: BenchmarkFixture, tmp_path: Path) -> None:
    pytest.importorskip("benchopt", reason="installed by 'make bench' alone")
    root = tmp_path / "grid"
    for name, text in (("objective", OBJECTIVE), ("datasets/noise", DATASET % TRIALS), ("solvers/at_once", SOLVER)):
        path = root / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text.replace("%%", "%"))
    command = [sys.executable, "-m", "benchopt", "run", str(root), "--no-plot", "--no-cache", "-r", "1"]
    measure(benchmark, command, 1, tmp_path / "out", dict(os.environ))
