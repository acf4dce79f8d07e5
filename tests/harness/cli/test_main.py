"""The command line: one clear line and the documented exit code, whatever is typed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from nrsfm import load
from tests.shell import TINY, Shell


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["run", "dataset=nowhere"], 3, "dataset 'nowhere' is none of"),
        (["run", "method=nothing"], 3, "method 'nothing' is none of"),
        (["run", "-m", "method=edsc,nothing"], 3, "nothing"),
        (["run", "method.l7=1"], 3, "method.l7"),
        (["run", "noise.level=loud"], 3, "noise.level"),
        (["run", "dataset=["], 3, "["),
        (["plan", "experiment=none"], 3, "experiment 'none' is none of"),
        (["run", "dataset=dance_yoga", "method=edsc"], 2, "dance.mat is not there"),
        (["run", "dataset=mocap_scene", "dataset.bodies=[dance,ghost]", "method=edsc"], 2, "ghost"),
        (["run", "dataset.bodies=[person]", "n_bodies=2", "method=edsc"], 2, "has 1 body and n_bodies is 2"),
        (["frobnicate"], 3, "frobnicate"),
        (["run", "-m", *TINY, "noise.level=0,-1"], 3, "noise.level is -1"),
        (["run", "--bogus"], 3, "--bogus"),
        (["report", "--bogus"], 3, "--bogus"),
        (["compare", "compare.tolerances=null"], 3, "compare.tolerances"),
        (["run", "dataset.bodies=5"], 3, "dataset.bodies is 5"),
        (["run", "dataset.scale=maybe", *TINY], 2, "dataset.scale"),
        (["run", *TINY, "method.clusterer.dimension=0"], 2, "dimension is 0"),
        (["report", "tracking.uri=nowhere://x", "quick"], 3, "nowhere://x"),
        ([], 3, ""),
    ],
)
def test_errors_are_one_clear_line(nrsfm: Shell, words: list[str], code: int, said: str) -> None:
    done = nrsfm(*words)
    assert done.returncode == code, (done.stdout, done.stderr)
    assert said in done.stderr
    assert len([line for line in done.stderr.splitlines() if said and said in line]) <= 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "is not there"),
        (b"", "not a readable MATLAB file"),
        (b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"\x0f\x00\x00\x00\xff\xff\x00\x00", "a field is cut off"),
        (np.zeros((9, 41)), "shape (9, 41), wanted (921, 41)"),
        (np.full((921, 41), np.nan), "NaN or infinite"),
    ],
)
def test_broken_files_are_one_clear_line(nrsfm: Shell, tmp_path: Path, content: object, said: str) -> None:
    path = tmp_path / "no-data/mocap/yoga.mat"
    path.parent.mkdir(parents=True)
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        savemat(path, {"S": content, "list": np.zeros((2, 1))})
    done = nrsfm("run", "dataset=mocap_scene", "dataset.bodies=[yoga,yoga]", "method=edsc")
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if said in line]
    assert str(path) in line


def test_usage_is_printed(nrsfm: Shell) -> None:
    done = nrsfm("--help")
    assert done.returncode == 0
    assert done.stdout.startswith("usage: nrsfm VERB")


def test_list_names_what_there_is(nrsfm: Shell) -> None:
    out = nrsfm("list").stdout
    for name in ("adaptive", "bmm_ssc3d", "dance_yoga", "procedural", "table1", "quick"):
        assert name in out


def test_plan_tells_done_from_missing(nrsfm: Shell) -> None:
    words = (*TINY, "noise.level=0,0.02")
    assert "2 missing" in nrsfm("plan", *words).stdout
    assert nrsfm("run", *TINY).returncode == 0
    planned = nrsfm("plan", *words)
    assert planned.returncode == 0
    assert "1 done, 1 missing" in planned.stdout
    assert "Expected:" in planned.stdout


def test_unwritable_output_is_one_line(nrsfm: Shell, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    done = nrsfm("run", *TINY, NRSFM_OUTPUT=str(blocked / "out"))
    assert done.returncode == 2
    assert str(blocked) in done.stderr


def test_hydra_flags_work(nrsfm: Shell) -> None:
    done = nrsfm("run", "--cfg", "job", "method=adaptive", "method.l1=0.5")
    assert done.returncode == 0
    assert "l1: 0.5" in done.stdout


def test_an_example_is_written_once_and_read_back(nrsfm: Shell, tmp_path: Path) -> None:
    file = tmp_path / "two.npz"
    done = nrsfm("data", "example", str(file))
    assert done.returncode == 0, done.stderr
    assert f"nrsfm solve {file} --bodies 2" in done.stdout
    scene = load(file)
    assert (scene.n_frames, scene.n_points, scene.n_bodies) == (309, 54, 2)
    assert scene.structure is not None and scene.cameras is not None
    np.testing.assert_allclose(scene.cameras @ scene.structure, scene.tracks, atol=1e-9)
    again = nrsfm("data", "example", str(file))
    assert again.returncode == 3
    assert "is there already" in again.stderr
