"""The wheel and the sdist hold every file, and the wheel runs where there is no checkout."""

from __future__ import annotations

import email
import os
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from nrsfm.harness.cli.verbs import VERBS
from tests.checkout import BESIDE, FILES, contents
from tests.harness.cli.test_completion import variables
from tests.shell import ROOT

Installed = Callable[..., subprocess.CompletedProcess[str]]


def names_in(wheel: Path) -> set[str]:
    """Names of the files that a wheel installs, without its metadata."""
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if ".dist-info/" not in name}


def test_the_wheel_holds_every_file_of_the_package_and_no_other(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        (about,) = [name for name in names if name.endswith(".dist-info/METADATA")]
        metadata = email.message_from_bytes(archive.read(about))
    inside = names_in(wheel)
    assert {f"src/{name}" for name in inside} == contents(built / "sources", "src/nrsfm")
    assert not [name for name in inside if "tests/" in name or "__pycache__" in name]
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)
    assert metadata["Name"] == "nrsfm"
    assert metadata["License-Expression"] == "MIT"
    assert metadata["Requires-Python"] == ">=3.11"
    assert {f"Programming Language :: Python :: 3.{n}" for n in (11, 12, 13)} <= set(metadata.get_all("Classifier", []))


def test_a_wheel_of_the_checkout_is_that_of_the_sdist(built: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path)]
    subprocess.run([*command, str(built / "sources")], check=True, capture_output=True, cwd=tmp_path)
    (direct,) = tmp_path.glob("*.whl")
    (by_sdist,) = built.glob("*.whl")
    assert names_in(direct) == names_in(by_sdist)


def test_the_sdist_holds_what_a_checkout_does(built: Path) -> None:
    """The files of the package as plain files under src, where the checkout has links to the top-level folders."""
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        members = [member for member in archive if not member.isdir()]
    assert all(member.isfile() for member in members)
    names = {member.name.partition("/")[2] for member in members}
    generated = {name for name in names if ".egg-info/" in name} | {"PKG-INFO", "setup.cfg"}
    assert names - generated == contents(built / "sources", "src/nrsfm", *BESIDE) | set(FILES)


def test_the_citation_is_valid() -> None:
    """By the required fields of the Citation File Format 1.2.0."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    assert citation["message"] and citation["title"] == "nrsfm" and citation["type"] == "software"
    assert citation["authors"] == [{"name": "the nrsfm developers"}]
    assert citation["license"] == "MIT"
    project = (ROOT / "pyproject.toml").read_text()
    assert f'version = "{citation["version"]}"' in project
    (paper,) = citation["references"]
    assert {"type", "title", "authors", "year"} <= paper.keys()
    assert [author["family-names"] for author in paper["authors"]] == ["Kumar", "Dai", "Li"]


def test_the_changelog_has_the_version() -> None:
    text = (ROOT / "CHANGELOG.md").read_text()
    version = yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"]
    assert f"## [{version}]" in text
    assert "### Added" in text


@pytest.fixture(scope="session")
def installed(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """The command in a clean environment, without a checkout and without git; skips without a package index."""
    folder = tmp_path_factory.mktemp("clean")
    subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True)
    (wheel,) = built.glob("*.whl")
    binaries = folder / "venv/bin"
    pip = [str(binaries / "pip"), "install", "--quiet", "--disable-pip-version-check"]
    done = subprocess.run(
        [*pip, "--constraint", str(ROOT / "constraints.txt"), str(wheel)], capture_output=True, text=True, check=False
    )
    if "from versions: none" in done.stderr:
        pytest.skip("no package index can be reached")
    assert done.returncode == 0, done.stderr
    (folder / "empty").mkdir()
    environment = {
        "PATH": str(binaries),
        "HOME": str(folder),
        "COLUMNS": "200",
        **{name: os.environ[name] for name in ("LANG", "TMPDIR") if name in os.environ},
    }

    def call(*words: str, code: int = 0, program: str = "nrsfm", **more: str) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            [str(binaries / program), *words],
            env=environment | more,
            cwd=folder / "empty",
            capture_output=True,
            text=True,
            timeout=1800,
            check=False,
        )
        assert "Traceback" not in done.stderr, done.stderr
        assert done.returncode == code, (words, done.stdout, done.stderr)
        return done

    return call


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_wheel_runs_in_a_clean_environment(installed: Installed) -> None:
    place = installed("-c", "import nrsfm; print(nrsfm.__file__)", program="python").stdout.strip()
    site = Path(place).parents[1]
    assert site.name == "site-packages"
    before = contents(site, ".")

    assert installed("--version").stdout == "nrsfm 0.1.0\n"
    assert "run" in installed("--help").stdout
    for verb in VERBS:
        installed(verb, "--help")
    assert "bmm_ssc3d" in installed("list").stdout
    answer = {"_ARGCOMPLETE_STDOUT_FILENAME": str(site / "answer")}
    installed(**variables("nrsfm run dataset=pro"), **answer)
    assert "dataset=procedural" in (site / "answer").read_text()
    (site / "answer").unlink()
    assert "complete" in installed("completion", "bash").stdout
    assert "0 of" in installed("data", "list").stdout
    assert "nrsfm can be used" in installed("doctor").stdout

    assert "1 run" in installed("run", "dataset=procedural", "dataset.points=8", "dataset.frames=12").stdout
    quick = ("experiment=quick", "method=edsc")
    installed("run", *quick)
    installed("report", "quick", "method=edsc", "--quiet")
    assert "missing" in installed("compare", *quick, code=2).stdout  # the baseline has methods that were not run
    refused = installed("bless", "quick", "--reason", "here", *quick, code=3).stderr
    assert "name a file, quick.json" in refused
    installed("bless", "quick.json", "--reason", "here", *quick)
    installed("compare", *quick, "compare.baseline=quick.json")

    installed("new", "method", "my_method")
    pip = ("install", "--quiet", "--disable-pip-version-check", "--editable", "nrsfm-my-method")
    assert contents(site, ".") == before
    installed(*pip, program="pip")
    assert "[nrsfm-my-method]" in installed("list", "methods").stdout
    assert "1 run" in installed("run", "method=my_method", "dataset.points=8", "dataset.frames=12").stdout
