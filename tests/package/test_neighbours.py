"""nrsfm beside packages whose names are those of its folders: Hugging Face's ``datasets``, and empty ones."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

import nrsfm
from tests.checkout import PACKAGES
from tests.shell import TINY

#: Prints a number that the stand-in of ``datasets`` gives.
LOAD = "import datasets; print(datasets.load_dataset('squad'))"
#: Adds the packages of this interpreter behind the environment's own, while tests run and not while pip does.
DEPENDENCIES = "import os, sys; sys.path.extend(filter(None, os.environ.get('DEPENDENCIES', '').split(os.pathsep)))\n"
PACKAGES_HERE = os.pathsep.join(path for path in sys.path if path.endswith("-packages"))


class Environment:
    """A virtual environment into which pip installs without network, and whose programs see this one's packages."""

    def __init__(self, folder: Path) -> None:
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder / "venv")], check=True)
        self.folder, self.programs = folder, folder / "venv/bin"
        site = sysconfig.get_path("purelib", "venv", {"base": str(folder / "venv")})
        (Path(site) / "dependencies.pth").write_text(DEPENDENCIES)

    def pip(self, *words: str, **variables: str) -> None:
        options = ("--quiet", "--disable-pip-version-check", "--python", str(self.programs / "python"))
        command = [sys.executable, "-m", "pip", *options, *words]
        subprocess.run(command, env=os.environ | variables, check=True, cwd=self.folder)

    def install(self, *words: str) -> None:
        build = {"DEPENDENCIES": PACKAGES_HERE} if "--editable" in words else {}  # setuptools among them
        self.pip("install", "--ignore-installed", "--no-deps", "--no-index", "--no-build-isolation", *words, **build)

    def __call__(self, program: str, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(self.programs / program), *words],
            env={
                "PATH": f"{self.programs}{os.pathsep}{os.environ['PATH']}",
                "HOME": str(self.folder),
                "NRSFM_OUTPUT": str(self.folder / "out"),
                "DEPENDENCIES": PACKAGES_HERE,
            },
            cwd=self.folder,
            capture_output=True,
            text=True,
            check=False,
        )

    def has_nrsfm(self) -> None:
        listed = self("nrsfm", "list")
        assert "bmm_ssc3d" in listed.stdout, listed.stderr
        done = self("python", "-c", "from nrsfm import load, solve; import nrsfm; print(nrsfm.__version__)")
        assert done.stdout == f"{nrsfm.__version__}\n", done.stderr

    def has_datasets(self) -> None:
        done = self("python", "-c", LOAD)
        assert done.stdout == "42\n", done.stderr


@pytest.fixture(scope="session")
def stand_in(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of a package called ``datasets`` that has ``load_dataset``."""
    wheel = tmp_path_factory.mktemp("stand_in") / "datasets-4.0-py3-none-any.whl"
    files = {
        "datasets/__init__.py": "def load_dataset(name):\n    return 42\n",
        "datasets/scene.py": "",
        "datasets-4.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: datasets\nVersion: 4.0\n",
        "datasets-4.0.dist-info/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    files["datasets-4.0.dist-info/RECORD"] = "".join(
        f"{name},,\n" for name in (*files, "datasets-4.0.dist-info/RECORD")
    )
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return wheel


@pytest.mark.parametrize("kind", ["wheel", pytest.param("editable", marks=pytest.mark.slow)])
def test_it_is_installed_beside_datasets(kind: str, built: Path, stand_in: Path, tmp_path: Path) -> None:
    """In both orders; and what remains works when either is uninstalled."""
    (wheel,) = built.glob("*.whl")
    product = [str(wheel)] if kind == "wheel" else ["--editable", str(built / "sources")]
    environment = Environment(tmp_path)
    environment.install(*product)
    environment.install(str(stand_in))
    environment.has_nrsfm()
    environment.has_datasets()

    environment.pip("uninstall", "--yes", "nrsfm")
    environment.has_datasets()
    assert "No module named 'nrsfm'" in environment("python", "-c", "import nrsfm").stderr

    environment.install(*product)
    environment.has_nrsfm()
    environment.has_datasets()

    environment.pip("uninstall", "--yes", "datasets")
    environment.has_nrsfm()
    done = environment("nrsfm", "run", *TINY)
    assert "1 run" in done.stdout, done.stderr
    assert "No module named 'datasets'" in environment("python", "-c", LOAD).stderr


def test_packages_of_the_same_names_change_nothing(environment: dict[str, str], tmp_path: Path) -> None:
    """On PYTHONPATH and in the working folder."""

    def call(*words: str, cwd: Path, **variables: str) -> str:
        done = subprocess.run(
            [sys.executable, *words],
            env=environment | variables,
            cwd=cwd,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout

    before = call("-m", "nrsfm", "list", cwd=tmp_path)
    empty = tmp_path / "empty"
    for name in PACKAGES:
        (empty / name).mkdir(parents=True)
        (empty / name / "__init__.py").touch()
    path = os.pathsep.join([str(empty), environment["PYTHONPATH"]])
    assert call("-m", "nrsfm", "list", cwd=empty, PYTHONPATH=path) == before
    assert "1 run" in call("-m", "nrsfm", "run", *TINY, cwd=empty, PYTHONPATH=path)
    code = "from nrsfm import load; from nrsfm.datasets.scene import Scene; import datasets; print(datasets.__file__)"
    assert call("-c", code, cwd=empty, PYTHONPATH=path).strip() == str(empty / "datasets/__init__.py")


def test_the_public_names_are_listed() -> None:
    assert {"__version__", "load", "solve", *nrsfm.__all__} <= set(dir(nrsfm))
    assert all(getattr(nrsfm, name) for name in nrsfm.__all__)
    with pytest.raises(AttributeError, match="no attribute 'lode'"):
        nrsfm.lode  # noqa: B018
