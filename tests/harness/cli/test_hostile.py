"""Command lines that mean harm: one clear line, a documented exit code, nothing executed, nothing written elsewhere."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.fuzz import files
from tests.shell import TINY, Shell

MEMORY = 6 << 30  # bytes of addresses; a list of 10^9 trials takes more


@pytest.fixture(autouse=True)
def bounded() -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["\x1b[2J"], 3, "is not a verb"),
        (["list", "\x1b[2J"], 3, "\\x1b"),
        (["plan", *TINY, "sweep=../../x"], 3, "sweep is"),
        (["plan", *TINY, "sweep=.."], 3, "sweep is '..'"),
        (["plan", *TINY, "sweep=."], 3, "sweep is '.'"),
        (["plan", *TINY, "dataset.name='<script>'"], 3, "dataset.name is"),
        (["plan", *TINY, "dataset.name=.."], 3, "dataset.name is"),
        (["plan", *TINY, "dataset.name='a\0b'"], 3, "dataset.name is"),
        (["plan", *TINY, "method.name='\x1b[2J'"], 3, "method.name is"),
        (["plan", *TINY, "noise.repeat=range(1000000000)"], 3, "more than 100000 trials"),
        (["plan", *TINY, "noise.repeat=range(0,10,0)"], 3, "more than 100000 trials"),
        (["plan", *TINY, "noise.level=range(0,1e300)"], 3, "more than 100000 trials"),
        (["plan", *TINY, "noise.repeat=range(1000)", "noise.level=range(1000)"], 3, "more than 100000 trials"),
        (["plan", *TINY, "dataset.name=${oc.env:PATH}"], 3, "dataset holds oc.env"),
        (["plan", *TINY, "+method.note=${oc.env:PATH}"], 3, "method holds oc.env"),
        (
            ["run", *TINY, "+hydra.callbacks.x._target_=os.system", "+hydra.callbacks.x.command=id"],
            3,
            "hydra.callbacks",
        ),
        (["run", "--config-path", "/etc"], 3, "one configuration"),
        (["data", "get", "../../x\x1b"], 3, "no file of the catalogue"),
        (["new", "method", "../x"], 3, "cannot be a name"),
        (["new", "method", "a\nb"], 3, "cannot be a name"),
        (["new", "method", "import"], 3, "cannot be a name"),
        (["solve", "/etc/passwd"], 2, "of no known kind"),
        (["solve", "a\n\x1b.npz"], 2, "\\x1b"),
    ],
    ids=lambda value: " ".join(value).encode("unicode_escape").decode()[-60:] if isinstance(value, list) else "",
)
def test_one_line(nrsfm: Shell, tmp_path: Path, words: list[str], code: int, said: str) -> None:
    done = nrsfm(*words)
    assert done.returncode == code, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.isprintable() and said in line
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").glob("**/*.json"))


@pytest.mark.parametrize(
    "words",
    [
        ["dataset=umpm", "dataset.take=../../secret", "dataset.name=a"],
        ["dataset=umpm", "dataset.folder=../..", "dataset.take=secret"],
        ["dataset=two_person", "dataset.take=../../secret", "dataset.name=a"],
    ],
)
def test_takes_are_in_their_folder(nrsfm: Shell, words: list[str]) -> None:
    done = nrsfm("plan", *words)
    assert done.returncode == 2 and "without its" in done.stdout


@pytest.mark.parametrize("suffix", ["npz", "mat"])
def test_a_file_that_inflates_a_thousandfold(nrsfm: Shell, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"bomb.{suffix}"
    if suffix == "npz":
        path.write_bytes(files.npz({"tracks": np.zeros((10_000, 2, 500))}, compressed=True))
    else:
        path.write_bytes(files.mat5(files.packed5(files.matrix5("W", (20_000, 500), bytes(80_000_000)))))
    assert path.stat().st_size < 100_000
    done = nrsfm("solve", str(path), "--bodies", "2")
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and "claims 76 MiB" in line and str(path) in line


def test_pickled_objects_are_not_loaded(nrsfm: Shell, tmp_path: Path) -> None:
    class Mark:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return Path.touch, (str(tmp_path / "executed"),)

    np.savez(tmp_path / "a.npz", tracks=np.array([Mark()], dtype=object))
    done = nrsfm("solve", str(tmp_path / "a.npz"), "--bodies", "2")
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and "holds objects" in line and not (tmp_path / "executed").exists()
