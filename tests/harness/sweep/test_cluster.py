"""The commands of docs/cluster.md as they are printed there, and a sweep under Slurm's signals."""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from tests.documents.documents import commands
from tests.harness.sweep import slurm
from tests.harness.tracking.servers import LEAN, Postgres, free_port, wait_for
from tests.shell import ODD, ROOT, TINY, Shell, processes, records, started, tracked, until

RAY = importlib.util.find_spec("hydra_plugins.hydra_ray_launcher")
SMALL = ("dataset.points=8", "dataset.frames=12", "noise.level=0", "method=edsc,ssc2d")  # two trials of a second


PAGE = [command.words for command in commands("docs/cluster.md")]
SWEEPS = [words for words in PAGE if words[:2] == ["nrsfm", "run"] and any("launcher=" in word for word in words[3:])]
THE_REST = [words for words in PAGE if words not in SWEEPS and "--cfg" not in words]


def test_the_page_holds_no_command_that_nothing_here_runs() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    installed = [word for words in THE_REST if words[0] == "pip" for word in words[2:]]
    assert {word.removeprefix("nrsfm[").removesuffix("]") for word in installed} <= extras.keys()
    assert len(SWEEPS) == 5
    assert {words[0] for words in THE_REST} == {"pip", "export", "createuser", "createdb", "mlflow", "nrsfm"}


@pytest.fixture
def variables(tmp_path: Path) -> dict[str, str]:
    """Slurm's programs on the path."""
    return slurm.install(tmp_path / "slurm")


@pytest.fixture
def cluster() -> Iterator[None]:
    """A Ray cluster of this machine alone."""
    command = [str(Path(sys.executable).with_name("ray")), "start", "--head", "--block", f"--port={free_port()}"]
    command += ["--num-cpus=2", "--include-dashboard=false", "--disable-usage-stats", "--object-store-memory=78643200"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if "--block" in line:  # it says that it is up, and stays
                break
        yield
    finally:
        process.terminate()
        process.communicate(timeout=600)


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("words", SWEEPS, ids=lambda words: " ".join(words[3:5]))
def test_sweeps_of_the_page(
    shell: Shell, variables: dict[str, str], tmp_path: Path, words: list[str], request: pytest.FixtureRequest
) -> None:
    if "hydra/launcher=ray" in words:
        if not RAY:
            pytest.skip("the ray extra is absent")
        request.getfixturevalue("cluster")  # joined by its address alone
    done = shell(*words[1:], *SMALL, timeout=900, **variables)
    assert done.returncode == 0, done.stderr
    assert "2 trials: 2 run. " in done.stdout
    assert sorted(t.outcome.key for t in tracked(tmp_path)) == sorted(records(tmp_path))
    if "hydra/launcher=submitit_slurm" in words:
        (script,) = (tmp_path / "slurm/jobs").glob("*/script.sh")
        options = {line.removeprefix("#SBATCH --") for line in script.read_text().splitlines() if "#SBATCH" in line}
        assert {"array=0-1%2", "cpus-per-task=2", "mem=10GB", "partition=cpu", "time=240"} <= options


SLOW = ("run", "-m", *ODD, "+method.how=slow", "noise.level=0.01", "workers=2", "hydra/launcher=submitit_slurm")


def tasks(tmp_path: Path) -> list[int]:
    """The processes that are an array's tasks."""
    found = []
    for pid in processes(tmp_path):
        try:
            words = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
        except OSError:
            continue
        if "submitit.core._submit" in words and "srun" not in words:
            found.append(pid)
    return found


@pytest.mark.slow
def test_a_preempted_task_is_queued_again_and_the_sweep_never_notices(
    environment: dict[str, str], variables: dict[str, str], tmp_path: Path
) -> None:
    """As Slurm preempts: SIGTERM, which is ignored, and the signal that asks to be queued again."""
    sweep = started(environment | variables, tmp_path, *SLOW, "noise.repeat=range(12)")
    until(lambda: records(tmp_path), sweep)
    (one, *_) = tasks(tmp_path)
    for sign in (signal.SIGTERM, signal.SIGUSR2):
        os.kill(one, sign)
    out, err = sweep.communicate(timeout=1200)
    assert (sweep.returncode, "12 trials: 12 run. " in out) == (0, True), (out, err)
    assert sorted(len(path.read_text()) for path in (tmp_path / "slurm/jobs").glob("*/*.starts")) == [1, 2]
    assert len(tracked(tmp_path)) == 12


@pytest.mark.slow
def test_an_array_goes_on_without_the_process_that_asked_for_it(
    shell: Shell, environment: dict[str, str], variables: dict[str, str], tmp_path: Path
) -> None:
    words = (*SLOW, "noise.repeat=range(12)")
    sweep = started(environment | variables, tmp_path, *words)
    until(lambda: records(tmp_path), sweep)
    sweep.kill()
    sweep.wait()
    assert len(records(tmp_path)) < 12
    until(lambda: len(records(tmp_path)) == 12)
    again = shell(*words, **variables)
    assert (again.returncode, "nothing to run, 12 done before" in again.stdout) == (0, True), again.stderr
    assert len(tracked(tmp_path)) == 12


@pytest.mark.slow
def test_what_a_scheduler_writes_down_holds_no_login(shell: Shell, variables: dict[str, str], tmp_path: Path) -> None:
    login = {
        "MLFLOW_TRACKING_USERNAME": "anna",
        "MLFLOW_TRACKING_PASSWORD": "Canary",
        "MLFLOW_TRACKING_TOKEN": "Canary",
    }
    words = ("run", "-m", *TINY, "dataset.seed=0,1", "hydra/launcher=submitit_slurm", "workers=2")
    assert shell(*words, **variables, **login).returncode == 0
    (written,) = (tmp_path / "slurm/jobs").glob("*/environment")
    assert "NRSFM_OUTPUT=" in written.read_text()
    for path in (*(tmp_path / "slurm").rglob("*"), *(tmp_path / "out").rglob("*")):
        assert not path.is_file() or b"Canary" not in path.read_bytes(), path


@pytest.mark.slow
@pytest.mark.postgres
@pytest.mark.timeout(1200)
def test_the_server_of_the_page(shell: Shell, environment: dict[str, str], tmp_path: Path) -> None:
    """Every line of the section, in its order: the database, the server, and a sweep that goes there."""
    port, secret = free_port(), "of-this-test"
    here = {"/shared": str(tmp_path), "tracker:5000": f"127.0.0.1:{port}", "5000": str(port), "0.0.0.0": "127.0.0.1"}
    theirs = re.compile("|".join(map(re.escape, here)))
    with TemporaryDirectory(prefix="postgres-") as folder:
        database = Postgres(Path(folder), secret)
        own = database.variables | LEAN
        process: subprocess.Popen[bytes] | None = None
        try:
            for words in THE_REST:
                words = [theirs.sub(lambda found: here[found[0]], word) for word in words]
                if words[0] == "export":
                    pairs = (word.replace("...", secret).split("=", 1) for word in words[1:])
                    own |= {name: value for name, value in pairs if name.startswith(("MLFLOW", "PG"))}
                elif words[0].startswith("create"):
                    typed = {"input": f"{secret}\n{secret}\n", "start_new_session": True}  # no terminal to ask at
                    program = [str(database.programs / words[0]), *words[1:]]
                    subprocess.run(program, env=os.environ | own, check=True, text=True, **typed)  # type: ignore[call-overload]
                elif words[0] == "mlflow":
                    command = [sys.executable, "-m", *words]
                    process = subprocess.Popen(
                        command, env=os.environ | own, cwd=tmp_path, stderr=subprocess.DEVNULL, start_new_session=True
                    )
                    wait_for(f"http://127.0.0.1:{port}", process)
                elif words[0] == "nrsfm":
                    small = SMALL if words[1] != "sync" else ()
                    done = shell(*words[1:], *small, **own)
                    assert done.returncode == 0, (words, done.stdout, done.stderr)
            assert len(records(tmp_path)) == 2
            assert len(list((tmp_path / "mlflow").rglob("arrays.npz"))) == 2
        finally:
            if process is not None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            database.stop()
