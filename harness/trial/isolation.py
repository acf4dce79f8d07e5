"""Run a function in a process of its own, so that whatever happens to it happens to it alone.

A server process that has numpy and the methods loaded forks the children, so a trial starts in milliseconds and
never inherits the state of the process that asked for it. Linux and macOS.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import multiprocessing.connection
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import forkserver, resource_tracker
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

from nrsfm.harness.record.environment import THREAD_VARIABLES
from nrsfm.harness.record.outcome import CRASHED, OK, OOM, TIMEOUT

PRELOAD = ["nrsfm.harness.trial.preload"]


OOM_EXIT, DISK_EXIT = 77, 78


STARTS = 5  # of the server, before no process can be started


LOST_EXIT = 255  # what multiprocessing says where nobody saw the child end


POLL = 0.25  # seconds between two questions whether the child is still wanted


LOOK = 1.0  # seconds between two looks at the memory that it and its own children hold


DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


class Stopped(Exception):
    """The child was ended before it was done, because it was no longer wanted."""


@dataclass(frozen=True)
class Ended:
    """How the process ended: a status and, unless ok, what happened in words."""

    status: str
    detail: str = ""


#: Held where a child is started, which changes the environment and the main module for a moment and asks after all
#: other children, and where one is asked how it ended: the server says so once.
_CHILDREN = threading.Lock()


_CONTEXT = multiprocessing.get_context("forkserver")


def start_server(threads: int = 1) -> None:
    """Start the server that forks the children, if it is not there: it loads their libraries while others do theirs."""
    _CONTEXT.set_forkserver_preload(PRELOAD)
    with _CHILDREN, _untouched(), _environment(dict.fromkeys(THREAD_VARIABLES, str(threads))), _light_main():
        forkserver.ensure_running()


def start_process(target: Callable[..., None], *args: Any) -> None:
    """Start a long-lived helper process that ends by itself when its connection does, and that Ctrl-C does not reach.

    It is a fresh interpreter that starts at once, beside the server that loads what trials need.
    """
    with _CHILDREN, _untouched(), _environment(dict.fromkeys(THREAD_VARIABLES, "1")), _light_main():
        multiprocessing.get_context("spawn").Process(target=target, args=args, daemon=True).start()


def run_isolated(
    target: str,
    args: tuple[Any, ...],
    *,
    seconds: float,
    memory_gb: float,
    threads: int,
    log: Path | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Ended:
    """Call a function in a child process under limits.

    Parameters
    ----------
    target : str
        ``module:function``, imported in the child alone; it leaves its result in a file.
    args : tuple
        Picklable.
    seconds, memory_gb : float
        The child and its descendants are killed after ``seconds``; allocations past ``memory_gb`` fail, and where
        they hold more than that together (Linux), or in shared memory, they are killed.
    threads : int
        BLAS threads of the child.
    log : Path, optional
        Where the child's standard output and error go.
    stopped : callable
        Asked several times a second; once true, the child is killed.

    Returns
    -------
    Ended
        ok, timeout, oom, or crashed with the signal or exit code.

    Raises
    ------
    Stopped
        If ``stopped`` said so.
    OSError
        If the child could not write its files for want of space.
    """
    child = _start(_child, (target, args, memory_gb, threads, log), threads)
    look = time.monotonic() + LOOK
    end = time.monotonic() + seconds
    try:
        while not multiprocessing.connection.wait([child.sentinel], min(POLL, max(0.0, end - time.monotonic()))):
            if stopped():
                raise Stopped
            now = time.monotonic()
            if now >= end:
                return Ended(TIMEOUT, f"took more than {seconds:g} s")
            if now >= look:
                look = now + LOOK
                if held_gb(child.pid or 0, memory_gb) > memory_gb:
                    return Ended(OOM, f"needed more than {memory_gb:g} GB together with its own processes")
    finally:
        _kill_group(child.pid)  # or whatever it left running
        with _CHILDREN:
            child.join()
    code = child.exitcode or 0
    if code == 0:
        return Ended(OK)
    if code == OOM_EXIT:
        return Ended(OOM, f"needed more than {memory_gb:g} GB")
    if code == DISK_EXIT:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), None if log is None else str(log.parent))
    if code == LOST_EXIT:
        return Ended(CRASHED, "the process was killed, or lost with the server that started it")
    if code < 0:
        name = signal.Signals(-code).name if -code in set(signal.Signals) else str(-code)
        return Ended(CRASHED, f"the process was killed by {name}")
    return Ended(CRASHED, f"the process ended with exit code {code}")


def _start(target: Callable[..., None], args: tuple[Any, ...], threads: int) -> ForkServerProcess:
    """Have the server fork a process; a server that is killed in this moment is started again."""
    for left in reversed(range(STARTS)):
        start_server(threads)
        child = _CONTEXT.Process(target=target, args=args)
        try:
            with _CHILDREN, _light_main():
                child.start()
            break
        except (EOFError, ConnectionError) as error:
            if not left:
                raise OSError(errno.ECHILD, f"the server that starts trials was lost {STARTS} times") from error
            time.sleep(0.2)
    return child


def _child(target: str, args: tuple[Any, ...], memory_gb: float, threads: int, log: Path | None) -> None:
    with contextlib.suppress(OSError):
        os.setsid()
    threading.Thread(target=_die_with_parent, daemon=True).start()
    if log is not None:
        handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        os.dup2(handle, 1)
        os.dup2(handle, 2)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    _limit_memory(memory_gb)
    if os.environ.get(THREAD_VARIABLES[0]) != str(threads):  # the server's, under which its libraries were loaded
        from threadpoolctl import threadpool_limits

        threadpool_limits(threads)
    try:
        module, name = target.split(":")
        getattr(importlib.import_module(module), name)(*args)
    except MemoryError:
        os._exit(OOM_EXIT)
    except OSError as error:
        if error.errno in DISK:
            os._exit(DISK_EXIT)
        raise
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # what Python tears down, the system does at once


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        with contextlib.suppress(OSError):
            os.killpg(0, signal.SIGKILL)


def _limit_memory(memory_gb: float) -> None:
    import resource

    limit = int(memory_gb * 2**30)
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_DATA, (limit, resource.getrlimit(resource.RLIMIT_DATA)[1]))


def held_gb(session: int, enough: float) -> float:
    """GB of memory, shared and not, that the processes of a session hold together; 0 where the system does not tell.

    Pages that they share count once. To find that out takes time, so it is left out while each for itself they hold
    no more than ``enough``.
    """
    members = _members(session)
    resident = sum(_told(f"/proc/{pid}/status", ("RssAnon:", "RssShmem:", "VmSwap:")) for pid in members)
    if resident <= enough:
        return resident
    return sum(_told(f"/proc/{pid}/smaps_rollup", ("Pss_Anon:", "Pss_Shmem:", "SwapPss:")) for pid in members)


def _members(session: int) -> list[int]:
    """The processes of a session; none where the system keeps no list."""
    found = []
    for name in os.listdir("/proc") if sys.platform == "linux" else ():  # noqa: PTH208, it asks for names
        with contextlib.suppress(OSError):
            if name.isdecimal() and os.getsid(int(name)) == session:
                found.append(int(name))
    return found


def _told(path: str, names: tuple[str, ...]) -> float:
    """GB that a file of the system says some things take; 0 for a process that has just ended."""
    try:
        lines = Path(path).read_text().splitlines()
    except OSError:
        return 0.0
    return sum(int(line.split()[1]) for line in lines if line.startswith(names)) / 2**20


def _kill_group(pid: int | None) -> None:
    if pid is not None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(pid, signal.SIGKILL)
        for one in (pid, *_members(pid)):  # a child may have made a group of its own
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(one, signal.SIGKILL)


@contextlib.contextmanager
def _untouched() -> Iterator[None]:
    """Keep Ctrl-C from what is started meanwhile, from its first instruction on; this process takes it afterwards."""
    resource_tracker.ensure_running()  # which lifts the block where it is not there yet
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """Set variables while the server may start: it and its children must have them before numpy loads."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _light_main() -> Iterator[None]:
    """Hide the main script from the child, which would otherwise import it again; the target is importable."""
    main = sys.modules["__main__"]
    hidden: dict[str, Any] = {n: main.__dict__.pop(n) for n in ("__file__", "__spec__") if n in main.__dict__}
    main.__spec__ = None
    try:
        yield
    finally:
        main.__dict__.update(hidden)


def peak_mb() -> float:
    """Largest resident size of this process so far, in MB."""
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)
