"""nrsfm doctor: what is fine is said to be, and each thing that is broken on purpose is found, with its remedy."""

from __future__ import annotations

import json
import os
import socket
import sqlite3
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path

import pytest

from nrsfm.harness.config.compose import compose_config
from nrsfm.harness.config.settings import Settings, read
from nrsfm.harness.doctor.checks import CHECKS, data, memory, output, packages, store, threads, trial
from nrsfm.harness.doctor.requirements import EXTRAS, NOTE, OK, PROBLEM, Finding, extras, versions
from tests.shell import ROOT, TINY, Shell


@pytest.fixture
def settings(environment: dict[str, str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Settings:
    monkeypatch.setenv("NRSFM_OUTPUT", environment["NRSFM_OUTPUT"])
    monkeypatch.setenv("NRSFM_DATA", environment["NRSFM_DATA"])
    return asked()


def asked(*overrides: str) -> Settings:
    return read(compose_config(overrides))[1]


def test_a_good_installation_can_be_used(nrsfm: Shell, tmp_path: Path) -> None:
    assert nrsfm("run", *TINY).returncode == 0
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out/trials").rglob("*")}
    done = nrsfm("doctor")
    assert done.returncode == 0, done.stdout
    lines = done.stdout.splitlines()
    assert lines[-1].startswith("nrsfm can be used")
    for topic in ("python", "libraries", "threads", "memory", "output", "data", "extras", "store", "trial"):
        assert any(line[8:].startswith(topic) for line in lines), topic
    assert "1 run, journal mode wal, writable" in done.stdout
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "out/trials").rglob("*")} == before
    assert not (tmp_path / "no-data").exists()


def test_findings_as_json(nrsfm: Shell) -> None:
    done = nrsfm("doctor", "--json", "workers=64")
    assert done.returncode == 0
    told = json.loads(done.stdout)
    assert told["usable"] is True
    (found,) = [each for each in told["findings"] if each["topic"] == "threads"]
    assert found["state"] == "note" and "workers=" in found["remedy"]


def test_nothing_is_made(settings: Settings) -> None:
    for check in CHECKS:
        if check is not trial:
            assert all(found.state != PROBLEM for found in check(settings))
    assert not settings.output.exists()


def test_a_library_that_cannot_be_loaded_is_a_finding(shell: Shell, tmp_path: Path) -> None:
    broken = tmp_path / "broken/scipy"
    broken.mkdir(parents=True)
    (broken / "__init__.py").write_text("raise ImportError('libopenblas.so: no such file')\n")
    done = shell("doctor", PYTHONPATH=os.pathsep.join([str(broken.parent), str(ROOT)]))
    assert done.returncode == 2
    (line,) = [line for line in done.stdout.splitlines() if "libopenblas" in line]
    assert line.startswith("problem libraries")


def test_requirements_are_held_to_what_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    needs = ["numpy>=99", "not-there-at-all>=1", "scipy>=1", 'also-not-there; extra == "umpm"']
    monkeypatch.setattr(metadata, "requires", lambda name: needs)
    wrong = [found for found in versions() if found.state == PROBLEM]
    assert [found.remedy for found in wrong] == ["pip install 'numpy>=99'", "pip install 'not-there-at-all>=1'"]
    assert "wanted >=99" in wrong[0].text and "is not installed" in wrong[1].text
    (umpm,) = [found for found in extras() if found.text.startswith("umpm")]
    assert umpm.state == NOTE and "also-not-there" in umpm.text and "nrsfm[umpm]" in umpm.remedy


def test_every_extra_of_users_is_told() -> None:
    import tomllib

    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(EXTRAS) == declared.keys() - {"dev", "bench", "docs", "fuzz"}


@pytest.mark.parametrize(
    ("overrides", "state", "remedy"),
    [
        (("workers=1", "threads=1"), OK, ""),
        (("workers=50", "threads=2"), NOTE, "workers="),
        (("workers=1", "threads=900"), NOTE, "threads=1"),
    ],
)
def test_oversubscription_is_warned_of(settings: Settings, overrides: tuple[str, ...], state: str, remedy: str) -> None:
    (found,) = threads(asked(*overrides))
    assert found.state == state and remedy in found.remedy
    assert "blas" in found.text


def test_memory_that_is_not_there_is_warned_of(settings: Settings) -> None:
    (found,) = memory(asked("limits.memory_gb=1000000"))
    assert found.state == NOTE and "limits.memory_gb=" in found.remedy


def test_output_that_cannot_be_written(settings: Settings, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (found,) = output(asked(f"output={tmp_path}/file/out"))
    assert found.state == PROBLEM and "NRSFM_OUTPUT" in found.remedy


def test_data_are_verified(settings: Settings) -> None:
    yoga = settings.data / "mocap/yoga.mat"
    yoga.parent.mkdir(parents=True)
    yoga.write_bytes(b"not what it was")
    (settings.data / "umpm").mkdir()
    (settings.data / "umpm/p1.c3d").touch()
    found = {each.text.partition(":")[0]: each for each in data(settings)}
    assert found["mocap"].state == PROBLEM and found["mocap"].remedy == "nrsfm data get mocap"
    assert found["hopkins155"].state == NOTE
    assert found["umpm"] == Finding("data", OK, "umpm: 1 file, not of the catalogue")


@pytest.mark.data
def test_data_that_are_right_are_said_to_be(data_folder: Path) -> None:
    found = {each.text.partition(":")[0]: each for each in data(asked(f"data='{data_folder}'"))}
    assert found["mocap"] == Finding("data", OK, "mocap: 9 of 9 files, verified")


class TestStore:
    def test_a_file_that_is_no_store(self, settings: Settings) -> None:
        settings.output.mkdir()
        (settings.output / "mlflow.db").write_bytes(b"this is no database, whatever its name says" * 50)
        (found,) = store(settings)
        assert found.state == PROBLEM and "not a database" in found.text and "nrsfm sync" in found.remedy

    def test_a_database_of_something_else(self, settings: Settings) -> None:
        settings.output.mkdir()
        with sqlite3.connect(settings.output / "mlflow.db") as db:
            db.execute("CREATE TABLE songs (name TEXT)")
        (found,) = store(settings)
        assert found.state == PROBLEM and "no such table: runs" in found.text

    def test_a_store_that_is_being_written(self, settings: Settings) -> None:
        settings.output.mkdir()
        with sqlite3.connect(settings.output / "mlflow.db") as db:
            db.execute("CREATE TABLE runs (experiment_id)")
            db.commit()
            db.execute("BEGIN EXCLUSIVE")
            (found,) = store(settings)
        assert found.state == NOTE and "locked" in found.text and "ask again" in found.remedy

    def test_a_server_that_is_not_there(self, settings: Settings) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        (found,) = store(asked("tracking=server", f"tracking.uri=http://127.0.0.1:{port}"))
        assert found.state == PROBLEM and "refused" in found.text

    def test_passwords_are_hidden(self, settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("STORE", "http://me:s3cret@127.0.0.1:1")
        (found,) = store(asked("tracking=server", "tracking.uri=${oc.env:STORE}"))
        assert found.state == PROBLEM
        assert "s3cret" not in f"{found}" and "127.0.0.1:1" in found.text

    def test_a_server_of_another_kind(self, settings: Settings, deaf: int) -> None:
        (found,) = store(asked("tracking=server", f"tracking.uri=http://127.0.0.1:{deaf}"))
        assert found.state == PROBLEM and f"127.0.0.1:{deaf}" in found.text


@pytest.fixture
def deaf() -> Iterator[int]:
    """The port of a server that hangs up on everybody."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while True:
                try:
                    server.accept()[0].close()
                except OSError:
                    return

        threading.Thread(target=serve, daemon=True).start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)


def test_a_trial_that_cannot_be_isolated(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    from nrsfm.harness.doctor import checks

    def refuse(*args: object, **more: object) -> None:
        raise PermissionError("no fork here")

    monkeypatch.setattr(checks, "execute", refuse)
    (found,) = trial(settings)
    assert found.state == PROBLEM and "no fork here" in found.text


def test_a_broken_package_is_a_note(settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not list(packages(settings))
    info = tmp_path / "site/broken-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[nrsfm.methods]\ngone = not_there_at_all:Gone\n")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    (found,) = packages(settings)
    assert found.state == NOTE and "not_there_at_all" in found.text and "uninstall broken" in found.remedy


def test_overrides_that_cannot_be_used_are_refused(nrsfm: Shell) -> None:
    done = nrsfm("doctor", "workers=many")
    assert done.returncode == 3
    assert "workers" in done.stderr


@contextmanager
def unprivileged() -> Iterator[None]:
    """Root, who may write everywhere, acts as another user meanwhile."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


def test_a_folder_without_the_right_to_write() -> None:
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o555)
        settings = asked(f"output={name}/out")
        with unprivileged():
            (finding,) = output(settings)
        Path(name).chmod(0o755)
    assert finding.state == PROBLEM
    assert "Permission denied" in finding.text
