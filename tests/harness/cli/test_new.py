"""nrsfm new: what it writes runs, is clean, and overwrites nothing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.harness.config.test_plugins import EXAMPLE
from tests.shell import ROOT, Shell

PARTS = ("harness", "methods", "datasets", "reports", "conf")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A copy of this checkout, without what is not code."""
    root = tmp_path / "checkout"
    for part in (*PARTS, "tests/__init__.py", "tests/conftest.py", "tests/shell.py", "pyproject.toml"):
        target = root / part
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / part, target)
    shutil.copytree(ROOT / "src", root / "src", symlinks=True, ignore=shutil.ignore_patterns("*.egg-info"))
    for part in ("methods", "datasets"):
        (root / "tests" / part).mkdir()
        (root / "tests" / part / "__init__.py").touch()
    return root


def run(root: Path, *words: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    paths = os.pathsep.join([str(root / "src"), str(root)])
    done = subprocess.run(
        [sys.executable, "-m", *words],
        env={
            **os.environ,
            "PYTHONPATH": paths,
            "NRSFM_OUTPUT": str(root.parent / "out"),
        },
        cwd=cwd or root,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert "Traceback" not in done.stderr, done.stderr
    return done


@pytest.mark.slow
def test_in_a_checkout_it_runs_at_once(checkout: Path) -> None:
    for kind, name in (("method", "nearest_neighbour"), ("dataset", "a_pair")):
        done = run(checkout, "nrsfm", "new", kind, name)
        assert done.returncode == 0, done.stderr
        for path in (f"{kind}s/{name}.py", f"conf/{kind}/{name}.yaml", f"tests/{kind}s/test_{name}.py"):
            assert f"wrote {path}" in done.stdout
            assert (checkout / path).is_file()
    done = run(checkout, "nrsfm", "run", "experiment=quick", "method=nearest_neighbour,edsc", "dataset=a_pair")
    assert "4 trials: 4 run" in done.stdout, done.stderr
    assert "nearest_neighbour" in run(checkout, "nrsfm", "list", "methods").stdout
    tests = ("tests/methods/test_nearest_neighbour.py", "tests/datasets/test_a_pair.py")
    done = run(checkout, "pytest", "-q", "-n0", "-p", "no:cacheprovider", *tests)
    assert done.returncode == 0, done.stdout
    for tool in (("ruff", "check"), ("ruff", "format", "--check"), ("mypy", "methods", "datasets")):
        done = run(checkout, *tool)
        assert done.returncode == 0, done.stdout


def test_the_example_is_what_the_commands_write(nrsfm: Shell, tmp_path: Path) -> None:
    for kind, name in (("method", "rigid_depth"), ("dataset", "breathing_clouds")):
        assert nrsfm("new", kind, name, "--package", "nrsfm-example").returncode == 0
    written = {p.relative_to(tmp_path / "nrsfm-example") for p in (tmp_path / "nrsfm-example").rglob("*.*")}
    assert len(written) == 8
    for path in written:
        if (tmp_path / "nrsfm-example" / path).is_file():
            assert (EXAMPLE / path).read_text() == (tmp_path / "nrsfm-example" / path).read_text(), path


def test_outside_a_checkout_it_makes_a_package(nrsfm: Shell, tmp_path: Path) -> None:
    done = nrsfm("new", "method", "my_method")
    assert done.returncode == 0
    assert "pip install --editable nrsfm-my-method" in done.stdout
    assert (tmp_path / "nrsfm-my-method/nrsfm_my_method/my_method.py").is_file()
    again = nrsfm("new", "method", "other", "--package", "nrsfm-my-method")
    assert again.returncode == 0
    declared = (tmp_path / "nrsfm-my-method/pyproject.toml").read_text()
    assert declared.count("nrsfm.methods") == 1
    assert 'my_method = "nrsfm_my_method.my_method:MyMethod"' in declared
    assert 'other = "nrsfm_my_method.other:Other"' in declared


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["method", "adaptive"], "there is a method adaptive already"),
        (["method", "bmm_ssc3d"], "there is a method bmm_ssc3d already"),
        (["method", "gaps"], "there is a method gaps already"),
        (["dataset", "procedural"], "there is a dataset procedural already"),
        (["method", "class"], "cannot be a name"),
        (["method", "progress"], "cannot be a name"),
        (["method", "My-Method"], "cannot be a name"),
        (["method", "../up"], "cannot be a name"),
        (["method", "x" * 31], "cannot be a name"),
        (["method", "mine", "--package", "methods"], "there is a module methods already"),
        (["method", "mine", "--package", "2d"], "cannot be a package's name"),
        (["sequence", "mine"], "sequence"),
        (["method"], "name"),
    ],
)
def test_names_are_refused_in_one_line(nrsfm: Shell, tmp_path: Path, words: list[str], said: str) -> None:
    done = nrsfm("new", *words)
    assert done.returncode == 3
    (line,) = done.stderr.splitlines()
    assert said in line
    assert not list(tmp_path.rglob("*.py"))


def test_nothing_is_overwritten(nrsfm: Shell, tmp_path: Path) -> None:
    test = tmp_path / "mine/tests/test_a_method.py"
    test.parent.mkdir(parents=True)
    test.write_text("mine")
    done = nrsfm("new", "method", "a_method", "--package", "mine")
    assert done.returncode == 3
    assert "test_a_method.py is there already" in done.stderr
    assert [p for p in (tmp_path / "mine").rglob("*") if p.is_file()] == [test]
    assert test.read_text() == "mine"


def test_a_pyproject_that_takes_no_line_is_refused(nrsfm: Shell, tmp_path: Path) -> None:
    about = tmp_path / "mine/pyproject.toml"
    about.parent.mkdir()
    for text in ("[project\n", '[project.entry-points]\n"nrsfm.methods" = {}\n'):
        about.write_text(text)
        done = nrsfm("new", "method", "a_method", "--package", "mine")
        assert done.returncode == 3
        assert str(Path("mine/pyproject.toml")) in done.stderr
        assert about.read_text() == text
