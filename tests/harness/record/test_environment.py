"""The environment of a trial, in its record and in the tracker, and that it names no host, user or folder."""

from __future__ import annotations

import getpass
import hashlib
import json
import os
import platform
import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from nrsfm.harness.record.environment import commit as commit_of
from nrsfm.harness.record.environment import cores, environment
from nrsfm.harness.tracking.tracker import Tracker
from tests.shell import ROOT, TINY, Shell, records, tracked


def git(root: Path, *words: str) -> str:
    own = ["-c", "user.name=n", "-c", "user.email=e@example.org", "-c", "commit.gpgsign=false"]
    return subprocess.run(["git", *own, "-C", str(root), *words], check=True, capture_output=True, text=True).stdout


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A repository with one commit, laid out as the project's."""
    root = tmp_path / "checkout"
    for name in ("harness/a.py", "methods/b.py", "notes.txt"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("1\n")
    git(root.parent, "init", "--quiet", str(root))
    git(root, "add", ".")
    git(root, "commit", "--quiet", "-m", "first")
    return root


def test_a_checkout_names_its_commit_and_whether_it_is_clean(checkout: Path) -> None:
    head = git(checkout, "rev-parse", "HEAD").strip()
    assert commit_of(checkout) == {"commit": head, "tree": "clean"}
    (checkout / "notes.txt").write_text("computes nothing\n")
    (checkout / "outputs").mkdir()
    (checkout / "outputs/x").write_text("2\n")
    assert commit_of(checkout)["tree"] == "clean"
    (checkout / "methods/new.py").write_text("not added yet\n")
    assert commit_of(checkout) == {"commit": head, "tree": "changed"}
    (checkout / "methods/new.py").unlink()
    (checkout / "harness/a.py").write_text("2\n")
    assert commit_of(checkout)["tree"] == "changed"


def test_no_repository_but_its_own_is_meant(checkout: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A package installed somewhere inside a repository; a user who works in one; a hook, which git tells its own."""
    installed = checkout / ".venv/lib/site-packages"
    installed.mkdir(parents=True)
    monkeypatch.chdir(checkout)
    assert commit_of(installed) == {}
    other = tmp_path / "other"
    git(tmp_path, "init", "--quiet", str(other))
    assert commit_of(other) == {}  # no commit yet
    monkeypatch.setenv("GIT_DIR", str(checkout / ".git"))
    assert commit_of(other) == {}
    monkeypatch.setenv("GIT_DIR", str(other / ".git"))
    assert (
        commit_of(checkout)["commit"] == git(tmp_path, "--git-dir", str(checkout / ".git"), "rev-parse", "HEAD").strip()
    )


def test_without_git_there_is_no_commit(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert commit_of(checkout) == {}


def test_a_record_names_what_computed_it_and_not_whose_machine_it_was(nrsfm: Shell, tmp_path: Path) -> None:
    assert nrsfm("run", *TINY, "threads=2").returncode == 0
    (one,) = tracked(tmp_path)
    held = one.outcome.environment
    assert held["cores"] == str(cores())
    assert held["threads"] == "2"
    assert held["blas"] and held["processor"] and held["code"]
    assert {"python", "numpy", "scipy", "scikit-learn", "mlflow", "hydra-core", "nrsfm"} <= held.keys()
    assert held["data"] == "v1"  # of the generator
    assert one.outcome.cpu_seconds and one.outcome.cpu_seconds > 0
    tags = Tracker(one.uri, tmp_path / "out").client.get_run(one.run_id).data.tags
    text = json.dumps(held) + json.dumps(tags)
    for folder in (tmp_path, Path(__file__).parents[3], Path.home()):
        assert str(folder) not in text
    for private in (platform.node(), getpass.getuser()):
        assert private not in {*held.values(), *tags.values()}


def test_the_data_are_known_by_their_checksum(nrsfm: Shell, tmp_path: Path) -> None:
    file = tmp_path / "no-data/hopkins155/arm_truth.mat"
    file.parent.mkdir(parents=True)
    x = np.random.default_rng(0).standard_normal((3, 12, 8))
    scipy.io.savemat(file, {"x": x, "s": np.repeat([[1], [2]], 6, axis=0)})
    assert nrsfm("run", "dataset=hopkins155", "dataset.scene=arm", "method=edsc_raw").returncode == 0
    ((_, record),) = records(tmp_path).items()
    assert record["environment"]["data"] == hashlib.sha256(file.read_bytes()).hexdigest()


def test_runs_are_found_by_their_environment(nrsfm: Shell, tmp_path: Path) -> None:
    """As tags, also of runs that 'nrsfm sync' writes."""
    assert nrsfm("run", *TINY).returncode == 0
    for turn in ("run", "sync"):
        (one,) = tracked(tmp_path)
        client = Tracker(one.uri, tmp_path / "out").client
        held = one.outcome.environment
        where = [client.get_experiment_by_name("nrsfm").experiment_id]
        for name in ("numpy", "code", "threads", "scikit-learn"):
            wanted = f"tags.`env.{name}` = '{held[name]}'"
            assert [run.info.run_id for run in client.search_runs(where, wanted)] == [one.run_id], (turn, name)
        assert client.search_runs(where, "tags.`env.numpy` = '0.1'") == []
        assert client.get_run(one.run_id).data.metrics["cpu_seconds"] == one.outcome.cpu_seconds
        client.delete_run(one.run_id)
        assert "1 run written" in nrsfm("sync").stdout


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="the tests do not run in a checkout")
def test_it_is_looked_up_once_for_all_trials(shell: Shell, tmp_path: Path) -> None:
    """git is asked by the server that forks the trials, and perhaps by the sweep's process; not by every trial."""
    calls, git = tmp_path / "calls", tmp_path / "bin/git"
    git.parent.mkdir()
    git.write_text(f"#!/bin/sh\necho once >> {calls}\necho 0123\n")
    git.chmod(0o755)
    words = ("run", "-m", *TINY, "noise.level=0.01", "noise.repeat=range(6)")
    done = shell(*words, PATH=f"{git.parent}{os.pathsep}{os.environ['PATH']}")
    assert "6 run" in done.stdout, done.stderr
    assert {r["environment"]["commit"] for r in records(tmp_path).values()} == {"0123"}
    assert len(calls.read_text().split()) <= 4


def test_it_is_looked_up_once() -> None:
    assert environment() is environment()
