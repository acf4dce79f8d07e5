"""A function that runs isolated affects only its own process."""

from __future__ import annotations

import mmap
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import forkserver
from pathlib import Path

import numpy as np
import pytest

from nrsfm.harness.record.outcome import CRASHED, OK, OOM, TIMEOUT
from nrsfm.harness.trial.isolation import Ended, Stopped, run_isolated
from tests.shell import until


def act(how: str, path: str) -> None:
    if how == "write":
        Path(path).write_text(os.environ["OMP_NUM_THREADS"])
    if how == "print":
        print("spoken")
        os.system("echo shouted >&2")
    if how == "sleep":
        time.sleep(600)
    if how == "child":
        child = subprocess.Popen(["sleep", "600"], process_group=0)
        Path(path).write_text(str(child.pid))
        time.sleep(600)
    if how == "segfault":
        os.kill(os.getpid(), signal.SIGSEGV)
    if how == "exit":
        os._exit(5)
    if how == "raise":
        raise RuntimeError("no")
    if how == "memory":
        np.ones(2**29)
    if how == "family":  # four of half a GB each
        forked = [os.fork() == 0 for _ in range(2)]
        held = np.ones(2**26)
        time.sleep(600)
        print(forked, held[0])
    if how == "heirs":  # four of one half GB
        held = np.ones(2**26)
        forked = [os.fork() == 0 for _ in range(2)]
        assert held.sum() == 2**26
        time.sleep(3)
        if any(forked):
            os._exit(0)
    if how == "shared":
        held = np.frombuffer(mmap.mmap(-1, 5 * 2**28), np.uint8)
        held[:] = 1
        time.sleep(600)
    if how == "threads":
        from threadpoolctl import threadpool_info

        Path(path).write_text(str({p["num_threads"] for p in threadpool_info()}))


def isolated(
    how: str, path: Path, seconds: float = 600.0, memory_gb: float = 2.0, stopped: Callable[[], bool] = lambda: False
) -> Ended:
    return run_isolated(
        f"{__name__}:act",
        (how, str(path)),
        seconds=seconds,
        memory_gb=memory_gb,
        threads=1,
        log=path.with_suffix(".log"),
        stopped=stopped,
    )


@pytest.mark.parametrize(
    ("how", "status", "word"),
    [
        ("write", OK, ""),
        ("segfault", CRASHED, "SIGSEGV"),
        ("exit", CRASHED, "exit code 5"),
        ("raise", CRASHED, "exit code 1"),
        ("memory", OOM, "more than 2 GB"),
    ],
)
def test_endings(tmp_path: Path, how: str, status: str, word: str) -> None:
    ended = isolated(how, tmp_path / "file")
    assert ended.status == status
    assert word in ended.detail


@pytest.mark.skipif(sys.platform != "linux", reason="shared memory is measured on Linux only")
@pytest.mark.parametrize(("how", "status"), [("family", OOM), ("shared", OOM), ("heirs", OK)])
def test_memory_of_a_trial_and_its_own_processes_counts_together(tmp_path: Path, how: str, status: str) -> None:
    ended = isolated(how, tmp_path / "file", memory_gb=1.2)
    assert ended.status == status
    assert "more than 1.2 GB together" in ended.detail or status == OK


def test_time_limit(tmp_path: Path) -> None:
    ended = isolated("sleep", tmp_path / "file", seconds=0.5)
    assert (ended.status, ended.detail) == (TIMEOUT, "took more than 0.5 s")


def test_descendants_end_with_the_child(tmp_path: Path) -> None:
    path = tmp_path / "file"
    with pytest.raises(Stopped):
        isolated("child", path, stopped=lambda: path.exists() and path.read_text() != "")
    state = Path(f"/proc/{path.read_text()}/stat")
    until(lambda: not state.exists() or state.read_text().split()[2] == "Z")


def test_output_goes_to_the_log(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert isolated("print", tmp_path / "file").status == OK
    assert set((tmp_path / "file.log").read_text().split()) == {"spoken", "shouted"}
    assert capfd.readouterr().out == ""


def test_blas_threads_are_capped(tmp_path: Path) -> None:
    assert isolated("threads", tmp_path / "file").status == OK
    assert (tmp_path / "file").read_text() == "{1}"


def test_killed_server_is_started_again(tmp_path: Path) -> None:
    """Whether it is killed before a process is asked for, while that starts, or after."""

    def kill() -> None:
        if pid := forkserver._forkserver._forkserver_pid:  # type: ignore[attr-defined]
            os.kill(pid, signal.SIGKILL)

    for seconds in (0, 0.005, 0.02, 0.05):
        assert isolated("write", tmp_path / "file").status == OK
        killer = threading.Timer(seconds, kill)
        killer.start()
        ended = isolated("write", tmp_path / "file")
        assert ended.status == OK or "lost with the server" in ended.detail
        killer.join()


def test_many_at_once_each_end_as_they_ended(tmp_path: Path) -> None:
    """Children of several threads: the end of one is never taken for another's."""
    ways = {"write": OK, "exit": CRASHED, "segfault": CRASHED}
    with ThreadPoolExecutor(4) as pool:
        jobs = [(how, pool.submit(isolated, how, tmp_path / f"{how}{i}")) for i in range(25) for how in ways]
    for how, job in jobs:
        ended = job.result()
        assert ended.status == ways[how]
        assert "lost" not in ended.detail
