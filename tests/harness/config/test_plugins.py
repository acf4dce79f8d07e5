"""Methods and datasets that installed packages bring: the example, and packages that are broken in one way each."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from nrsfm.datasets import registry as datasets
from nrsfm.harness.config.spans import expand
from nrsfm.harness.record.environment import environment
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.trial.execute import repeats
from nrsfm.harness.trial.identity import described, packages_of
from nrsfm.methods import registry as methods
from tests.shell import ROOT, TINY, Shell, records

EXAMPLE = ROOT / "examples/nrsfm-example"

GOOD = '''
import numpy as np
from nrsfm.methods.base import Method, Reconstruction

class Halves(Method):
    """The first half of the tracks, and the rest."""
    provides = frozenset({"labels"})
    uses_cameras = False
    def reconstruct(self, observations, n_bodies):
        n_points = observations.tracks.shape[2]
        return Reconstruction(labels=np.arange(n_points) * n_bodies // n_points)
'''
METHOD = "[nrsfm.methods]\nhalves = {package}:Halves\n"
DATASET = "[nrsfm.datasets]\nbad = {package}\n"
NUMBERS = count()  # no module is imported twice

Make = Callable[..., str]


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Lay a package of a name of its own out as pip would, and put it on the path; its name."""
    root = tmp_path / "site"
    root.mkdir()
    monkeypatch.syspath_prepend(str(root))
    methods.others.cache_clear()
    datasets.others.cache_clear()

    def make(code: str, declared: str, **files: str) -> str:
        name = f"theirs_{next(NUMBERS)}"
        for path, text in {"__init__.py": code, **files}.items():
            (root / name / path).parent.mkdir(parents=True, exist_ok=True)
            (root / name / path).write_text(text)
        info = root / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(declared.format(package=name))
        return name

    return make


def lines(text: str, word: str) -> list[str]:
    return [line for line in text.splitlines() if word in line]


@pytest.fixture(scope="module")
def path_of_example(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The PYTHONPATH of a folder into which pip, without network, has installed the example."""
    pytest.importorskip("flit_core")
    site = tmp_path_factory.mktemp("example") / "site"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--target", str(site), str(EXAMPLE)], check=True)
    return {"PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])}


@pytest.mark.slow
def test_the_example_is_listed_planned_and_swept(shell: Shell, path_of_example: dict[str, str]) -> None:
    path = path_of_example
    listed = shell("list", **path)
    assert listed.stderr == ""
    for name in ("rigid_depth", "breathing_clouds"):
        (line,) = lines(listed.stdout, f"{name} ")
        assert "[nrsfm-example]" in line

    sweep = ("method=rigid_depth,edsc", "dataset=breathing_clouds,procedural", "dataset.points=12", "dataset.frames=20")
    assert "4 missing" in shell("plan", *sweep, **path).stdout
    done = shell("run", "-m", *sweep, **path)
    assert done.returncode == 0, done.stderr
    assert "4 trials: 4 run" in done.stdout
    assert "4 done" in shell("plan", *sweep, **path).stdout


@pytest.mark.slow
def test_the_example_runs_under_joblib_in_experiments_and_by_its_own_tests(
    shell: Shell, path_of_example: dict[str, str]
) -> None:
    path = path_of_example
    words = ("experiment=quick", "method=rigid_depth", "dataset=breathing_clouds", "hydra/launcher=joblib")
    done = shell("run", *words, **path)
    assert "2 trials: 2 run" in done.stdout, done.stderr
    tests = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-c", os.devnull, "-p", "no:cacheprovider", str(EXAMPLE / "tests")],
        env=os.environ | path | {"PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert tests.returncode == 0, tests.stdout


BROKEN_METHODS = [
    ("def broken(:\n", "SyntaxError"),
    ("import nowhere_to_be_found\n", "nowhere_to_be_found"),
    ("raise RuntimeError('on import')\n", "RuntimeError: on import"),
    (GOOD.replace("Halves", "Quarters"), "AttributeError"),
    ("Halves = 3\n", "not a class"),
]


@pytest.mark.parametrize(("code", "error"), BROKEN_METHODS)
def test_a_broken_method_is_named(nrsfm: Shell, package: Make, code: str, error: str) -> None:
    name = package(code, METHOD, **{"conf/method/halves.yaml": "name: halves\nalgorithm: halves\n"})
    listed = nrsfm("list")
    assert listed.returncode == 0
    assert "bmm_ssc3d" in listed.stdout
    assert "halves" in listed.stdout
    (line,) = listed.stderr.splitlines()
    assert name in line
    assert error in line


def first_then_slow(cases: list[tuple[str, str]]) -> list[Any]:
    """The first case for every run of the tests; the others, which take the same way, are marked slow."""
    return [cases[0], *(pytest.param(*case, marks=pytest.mark.slow) for case in cases[1:])]


@pytest.mark.parametrize(("code", "error"), first_then_slow(BROKEN_METHODS))
def test_a_broken_method_harms_no_other(nrsfm: Shell, package: Make, code: str, error: str) -> None:
    name = package(code, METHOD, **{"conf/method/halves.yaml": "name: halves\nalgorithm: halves\n"})
    done = nrsfm("run", "-m", "method=halves,edsc", *TINY[:2])
    assert done.returncode == 2
    assert "2 trials: 2 run, 1 failed" in done.stdout
    (line,) = lines(done.stderr, name)
    assert error in line


BROKEN_DATASETS = [
    ("def load(s, f): return 1 / 0\ndef digest(s, f): return '1'\n", "ZeroDivisionError"),
    ("", "load and digest"),
    ("import nowhere_to_be_found\n", "nowhere_to_be_found"),
    ("def load(s, f): ...\ndef digest(s, f): return s['seeds']\n", "KeyError"),
    ("def load(s, f): ...\ndef digest(s, f): return b'1'\n", "gave bytes, wanted a str"),
    ("def load(s, f): return None\ndef digest(s, f): return '1'\n", "gave NoneType, wanted a Scene"),
]


@pytest.mark.parametrize(("code", "error"), BROKEN_DATASETS)
def test_a_broken_dataset_is_named(nrsfm: Shell, package: Make, code: str, error: str) -> None:
    package(code, DATASET, **{"conf/dataset/bad.yaml": "name: bad\nsource: bad\n"})
    listed = nrsfm("list")
    assert listed.returncode == 0
    assert "dance_yoga" in listed.stdout
    assert error in nrsfm("plan", "dataset=bad", "method=bmm").stdout.replace("\n", " ")


@pytest.mark.parametrize(("code", "error"), first_then_slow(BROKEN_DATASETS))
def test_a_broken_dataset_harms_no_other(nrsfm: Shell, package: Make, code: str, error: str) -> None:
    package(code, DATASET, **{"conf/dataset/bad.yaml": "name: bad\nsource: bad\n"})
    done = nrsfm("run", "-m", "dataset=bad,procedural", "method=edsc")
    assert done.returncode == 2
    assert "2 trials: 2 run, 1 failed" in done.stdout
    (line,) = lines(done.stderr, error)
    assert "dataset bad" in line


def test_names_that_are_taken_stay_with_their_owner(nrsfm: Shell, package: Make) -> None:
    files = {"conf/method/edsc.yaml": "# Not EDSC.\nname: edsc\nalgorithm: edsc\n"}
    name = package(GOOD, METHOD.replace("halves", "edsc"), **files)
    listed = nrsfm("list")
    assert "Not EDSC" not in listed.stdout
    for word in (f"package {name}: edsc is not used", f"package {name}: method/edsc is not used"):
        assert len(lines(listed.stderr, word)) == 1
    names = [package(GOOD, METHOD) for _ in range(2)]
    (line,) = lines(nrsfm("list").stderr, "halves is not used")
    assert all(name in line for name in names)
    refused = nrsfm("new", "method", "halves")
    assert refused.returncode == 3
    assert "there is a method halves already" in refused.stderr


@pytest.mark.parametrize("text", ["name: [halves\n", "name: 'halves\n\x00"])
def test_a_broken_configuration_is_one_line(nrsfm: Shell, package: Make, text: str) -> None:
    name = package(GOOD, METHOD, **{"conf/method/halves.yaml": text})
    listed = nrsfm("list")
    assert listed.returncode == 0
    (line,) = lines(listed.stderr, name)
    assert "halves.yaml cannot be read" in line
    done = nrsfm("run", "method=halves", *TINY[:2])
    assert done.returncode == 3
    assert len(done.stderr.splitlines()) == 1
    assert nrsfm("plan", *TINY).returncode == 0


@pytest.mark.slow
def test_a_constructor_that_fails_is_one_line(nrsfm: Shell, package: Make) -> None:
    code = GOOD + "    def __init__(self, n=1):\n        self.m = 1 / n\n"
    package(code, METHOD, **{"conf/method/halves.yaml": "name: halves\nalgorithm: halves\nn: 1\n"})
    for n, said in (("0", "ZeroDivisionError"), ("1", "AttributeError")):
        done = nrsfm("run", "method=halves", f"method.n={n}", *TINY[:2])
        assert done.returncode == 2
        assert len(lines(done.stderr, said)) == 1


def test_a_forecast_that_fails_is_one_line(nrsfm: Shell, package: Make) -> None:
    code = GOOD + "    def memory(self, *sizes):\n        raise OSError('none')\n"
    package(code, METHOD, **{"conf/method/halves.yaml": "name: halves\nalgorithm: halves\n"})
    planned = nrsfm("plan", "method=halves", *TINY[:2])
    assert planned.returncode == 2
    assert "Halves.memory ended with OSError" in planned.stdout


def test_records_tell_which_package_they_are_from(nrsfm: Shell, package: Make, tmp_path: Path) -> None:
    """Two methods of two packages, one of ours: each record names its own package, and no other."""
    names = [package(GOOD, METHOD.replace("halves", f"halves_{i}")) for i in range(2)]
    algorithms = "method.algorithm=halves_0,halves_1"
    done = nrsfm("run", "-m", *TINY, "~method.clusterer", algorithms)
    assert done.returncode == 0, done.stdout
    assert nrsfm("run", *TINY).returncode == 0
    found = {r["parameters"]["method"]["algorithm"]: r["environment"] for r in records(tmp_path).values()}
    digests = set()
    for i, name in enumerate(names):
        package_, version, digest = found[f"halves_{i}"]["packages"].split()
        assert (package_, version) == (name, "1.0")
        digests.add(digest)
    assert len(digests) == 1  # of the source alone: both have the same
    assert "packages" not in found["cluster_tracks"]


def test_a_packages_edited_source_makes_its_records_stale(package: Make, tmp_path: Path) -> None:
    """Though its version was not raised; records of ours are not touched by it."""
    name = package(GOOD, METHOD, **{"inner/deep.py": "x = 1\n"})
    ours, theirs = (expand([*TINY, *words])[0] for words in ([], ["~method.clusterer", "method.algorithm=halves"]))
    before = [
        Outcome(
            "k", "s", "ok", "d", "m", "", "", "", 0, 0, environment={**environment(), "packages": packages_of(trial)}
        )
        for trial, _ in (ours, theirs)
    ]
    for edited in (False, True):
        if edited:
            (tmp_path / "site" / name / "inner/deep.py").write_text("x = 2\n")
            described.cache_clear()  # as by a new process
        stale = [repeats(b, trial, "stale") for b, (trial, _) in zip(before, (ours, theirs), strict=True)]
        assert stale == [False, edited]


def test_a_choice_is_described_by_a_whole_sentence() -> None:
    from nrsfm.harness.config.plugins import choices

    for group in ("method", "dataset", "experiment"):
        for name, (sentence, package) in choices(group).items():
            assert package or (sentence.endswith(".") and not sentence.startswith("dataset=")), f"{group}/{name}"
