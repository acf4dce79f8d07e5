"""C3D files: what ezc3d wrote comes back, and whatever is broken gives one line and takes no memory."""

from __future__ import annotations

import random
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.readers import c3dfile, guarded_child
from nrsfm.datasets.readers.c3dfile import read_c3d
from tests.datasets.conftest import WriteC3D

F, M = 6, 4
LABELS = ["A:one", "A:two", "B:one", "*4"]


def points(n_markers: int = M) -> Array:
    """Positions that single precision holds exactly."""
    return np.random.default_rng(0).integers(1, 4000, (F, 3, n_markers)) / 4.0


@pytest.fixture
def whole(tmp_path: Path, write_c3d: WriteC3D) -> Path:
    return write_c3d(tmp_path / "take.c3d", points(), LABELS)


def complaint(path: Path) -> str:
    with pytest.raises(DatasetError) as caught:
        read_c3d(path)
    text = str(caught.value)
    assert "\n" not in text and len(text) < 500 and str(path) in text
    return text


def patched(path: Path, offset: int, kind: str, *values: int) -> Path:
    content = bytearray(path.read_bytes())
    struct.pack_into(f"<{kind}", content, offset, *values)
    path.write_bytes(content)
    return path


def parameter(path: Path, name: str) -> int:
    """Where a parameter's numbers start: behind its name, offset, type and number of dimensions (a scalar's)."""
    content = path.read_bytes()
    at = content.index(name.encode(), 512) + len(name)
    return at + 4 + content[at + 3]


def test_round_trip(whole: Path) -> None:
    read = read_c3d(whole)
    np.testing.assert_array_equal(read.points, points())
    assert (read.labels, read.rate, read.unit) == (tuple(LABELS), 100.0, "mm")


def test_points_that_were_not_seen(tmp_path: Path, write_c3d: WriteC3D) -> None:
    """Residual -1, NaN, and all zero are NaN; a single zero coordinate is a coordinate."""
    P = points()
    P[2, :, 1], P[4, :, 3], P[0, 0, 0] = np.nan, 0, 0
    path = write_c3d(tmp_path / "gaps.c3d", P, LABELS)
    expected = P.copy()
    expected[4, :, 3] = np.nan
    np.testing.assert_array_equal(read_c3d(path).points, expected)
    start = (struct.unpack_from("<H", path.read_bytes(), 16)[0] - 1) * 512
    patched(path, start + 16 * 2 + 12, "f", -1)  # frame 0, marker 2: its residual alone
    expected[0, :, 2] = np.nan
    np.testing.assert_array_equal(read_c3d(path).points, expected)


def test_more_labels_than_one_parameter_holds(tmp_path: Path, write_c3d: WriteC3D) -> None:
    labels = [f"set:m{k}" for k in range(300)]
    read = read_c3d(write_c3d(tmp_path / "many.c3d", points(300), labels))
    assert read.labels == tuple(labels) and read.points.shape == (F, 3, 300)


def test_absent(tmp_path: Path) -> None:
    with pytest.raises(MissingData, match="is not there"):
        read_c3d(tmp_path / "none.c3d")


def test_without_the_reader(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(DatasetError, match=r"nrsfm\[umpm\]"):
        read_c3d(whole)


def test_truncated(whole: Path) -> None:
    content = whole.read_bytes()
    for kept in (0, 1, 100, 511, 512, 514):
        whole.write_bytes(content[:kept])
        complaint(whole)
    start = (struct.unpack_from("<H", content, 16)[0] - 1) * 512
    for kept in (start, start + 16 * M * F - 1):
        whole.write_bytes(content[:kept])
        assert f"cut short: {start + 16 * M * F - kept} bytes" in complaint(whole)


def test_no_points(whole: Path) -> None:
    assert "holds no points" in complaint(patched(whole, 2, "H", 0))


@pytest.mark.parametrize(("offset", "value"), [(2, 3), (2, 65535), (8, 4), (8, 65535), (8, 0), (16, 0), (16, 60000)])
def test_wrong_counts(whole: Path, offset: int, value: int) -> None:
    complaint(patched(whole, offset, "H", value))


@pytest.mark.parametrize(("name", "value"), [("USED", 3), ("USED", 5), ("USED", 0), ("FRAMES", 5), ("FRAMES", 7)])
def test_parameters_that_contradict_the_header(whole: Path, name: str, value: int) -> None:
    patched(whole, parameter(whole, name), "H", value)
    if name == "FRAMES" and value == 7:  # the seventh frame is the padding of the last block
        assert "7 of 4 were found" in complaint(whole)
    else:
        complaint(whole)


def test_a_huge_header_takes_no_memory(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """65535 frames of 65535 points are refused before the reader is started."""
    monkeypatch.setattr(c3dfile, "read_guarded", lambda *_: pytest.fail("the reader was started"))
    patched(patched(whole, 2, "H", 65535), 6, "2H", 1, 65535)
    assert "positions, more than" in complaint(whole)


def test_a_reader_that_crashes_or_hangs_is_a_damaged_file(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    child = whole.with_name("child.py")
    monkeypatch.setattr(guarded_child, "__file__", str(child))
    for code, message in (
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "ended with signal 11"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGXCPU)", "took too long"),
        ("import sys; sys.exit('first\\nthe <b>last</b> \\x1b line')", "the <b>last</b> \\x1b line"),
        ("raise SystemExit(3)", "no reason given"),
    ):
        child.write_text(code)
        assert message in complaint(whole)


def mutants(content: bytes, seeds: range) -> Any:
    """The file with up to eight bytes of its header and parameters changed, at times cut as well."""
    head = (struct.unpack_from("<H", content, 16)[0] - 1) * 512
    for seed in seeds:
        chance = random.Random(seed)
        changed = bytearray(content)
        for _ in range(chance.randint(1, 8)):
            changed[chance.randrange(head)] = chance.randrange(256)
        yield bytes(changed[: chance.randrange(len(changed))] if chance.random() < 0.1 else changed)


def survive(path: Path, seeds: range) -> int:
    """Read every mutant, which gives points or one line; how many gave points."""
    content, read = path.read_bytes(), 0
    for mutant in mutants(content, seeds):
        path.write_bytes(mutant)
        try:
            markers = read_c3d(path)
            assert markers.points.shape[1:] == (3, len(markers.labels))
            read += 1
        except DatasetError as error:
            assert "\n" not in str(error) and str(path) in str(error)
    return read


def test_mutants(whole: Path) -> None:
    assert 0 < survive(whole, range(12)) < 12


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_many_mutants(whole: Path) -> None:
    assert 0 < survive(whole, range(40, 600)) < 560


@pytest.mark.data
def test_real_file(data_folder: Path) -> None:
    read = read_c3d(data_folder / "c3d/cmu_02_01.c3d")
    assert read.points.shape == (343, 3, 41) and len(set(read.labels)) == 41
    assert (read.rate, read.unit, read.first_frame) == (120.0, "mm", 50)
    height = read.points[:, 2]
    assert np.isfinite(read.points).all() and 0 < height.min() < 100 and 1500 < height.max() < 2000
