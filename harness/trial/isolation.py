"""Run a function in its own process under limits of time and memory, so that its failure affects nothing else.

A server process that has loaded numpy and the methods forks the children. So a trial starts in milliseconds, and it
inherits no state of the process that starts it. Linux and macOS.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import multiprocessing
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from multiprocessing import connection, forkserver, resource_tracker
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

import psutil

from nrsfm.harness.config.address import SECRETS
from nrsfm.harness.record.environment import THREAD_VARIABLES
from nrsfm.harness.record.outcome import CRASHED, OK, OOM, TIMEOUT

PRELOAD = ["nrsfm.harness.trial.preload"]
OOM_EXIT, DISK_EXIT = 77, 78  # exit codes of a child without memory, without disk
LOST_EXIT = 255  # the exit code that multiprocessing reports when the server died before the child
STARTS = 5  # attempts to start the server
POLL_SECONDS, MEMORY_SECONDS = 0.25, 1.0  # between two calls of ``stopped``, between two measurements of memory
DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


class Stopped(Exception):
    """The child was killed because ``stopped`` returned true."""


@dataclass(frozen=True)
class Ended:
    """How the process ended: a status and, unless that is ok, a description."""

    status: str
    detail: str = ""


#: Serialises starting a child, which changes the environment and the main module for a moment and polls all other
#: children, and joining one: the server reports the end of a child only once.
_CHILDREN = threading.Lock()
_CONTEXT = multiprocessing.get_context("forkserver")


def start_server(threads: int = 1) -> None:
    """Start the server that forks the children, unless it runs; its libraries load in the background."""
    _CONTEXT.set_forkserver_preload(PRELOAD)
    variables = dict.fromkeys(THREAD_VARIABLES, str(threads)) | dict.fromkeys(SECRETS)  # trials need no login
    with _CHILDREN, without_interrupt(), with_environment(variables), _light_main():
        forkserver.ensure_running()


def start_process(target: Callable[..., None], *args: Any) -> None:
    """Start a helper process that Ctrl-C does not reach; ``target`` returns when its connection closes.

    It is a new interpreter, so that it starts at once and does not wait for the server to load its libraries.
    """
    with _CHILDREN, without_interrupt(), with_environment(dict.fromkeys(THREAD_VARIABLES, "1")), _light_main():
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
    """Call a function in a child process under limits; returns how it ended.

    Raises OSError if the child could not write its files because the disk is full.

    Parameters
    ----------
    target : str
        ``module:function``, imported in the child only; it writes its result to a file.
    args : tuple
        Picklable.
    seconds, memory_gb : float
        The child and its descendants are killed after ``seconds``. Allocations beyond ``memory_gb`` fail, and the
        processes are killed when together they hold more; memory that they share counts once (Linux).
    threads : int
        BLAS threads of the child.
    log : Path, optional
        Where the child's standard output and error go.
    stopped : callable
        Called several times a second; when it returns true the child is killed and Stopped is raised.
    """
    child = _start(_child, (target, args, memory_gb, threads, log), threads)
    measure_at = time.monotonic() + MEMORY_SECONDS
    end = time.monotonic() + seconds
    try:
        while not connection.wait([child.sentinel], max(0.0, min(POLL_SECONDS, end - time.monotonic()))):
            if stopped():
                raise Stopped
            now = time.monotonic()
            if now >= end:
                return Ended(TIMEOUT, f"took more than {seconds:g} s")
            if now >= measure_at:
                measure_at = now + MEMORY_SECONDS
                if held_gb(child.pid or 0, memory_gb) > memory_gb:
                    return Ended(OOM, f"needed more than {memory_gb:g} GB together with its own processes")
    finally:
        _kill_session(child.pid)  # the child, or what it left running
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
    """Have the server fork a process; starts the server again if it is killed meanwhile."""
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
    """Body of the child process: limit it, redirect its output, and call the target."""
    with contextlib.suppress(OSError):
        os.setsid()
    threading.Thread(target=_die_with_parent, daemon=True).start()
    if log is not None:
        handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        os.dup2(handle, 1)
        os.dup2(handle, 2)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    with contextlib.suppress(ValueError, OSError):
        limit = int(memory_gb * 2**30)
        resource.setrlimit(resource.RLIMIT_DATA, (limit, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    if os.environ.get(THREAD_VARIABLES[0]) != str(threads):  # the setting under which the server loaded its libraries
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
    os._exit(0)  # skips Python's slow tear-down


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        with contextlib.suppress(OSError):
            os.killpg(0, signal.SIGKILL)


def held_gb(session: int, enough: float) -> float:
    """GB of memory that the processes of a session hold together.

    Pages that they share count once, which takes time to measure. So it is only done when the sum of their resident
    sizes exceeds ``enough``.
    """
    resident = alone = 0
    members = _members(session)
    for member in members:
        with contextlib.suppress(psutil.Error):  # it has ended
            resident += member.memory_info().rss
    if resident <= enough * 2**30:
        return resident / 2**30
    for member in members:
        with contextlib.suppress(psutil.Error):
            info = member.memory_full_info()
            alone += info.pss + info.swap if sys.platform == "linux" else info.uss
    return alone / 2**30


def _members(session: int) -> list[psutil.Process]:
    """The processes of a session."""
    members = []
    for pid in psutil.pids():
        with contextlib.suppress(OSError, psutil.Error):
            if os.getsid(pid) == session:
                members.append(psutil.Process(pid))
    return members


def _kill_session(pid: int | None) -> None:
    """Kill a session's leader, its process group, and members that made groups of their own."""
    if pid is not None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(pid, signal.SIGKILL)
        for member in (pid, *(process.pid for process in _members(pid))):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(member, signal.SIGKILL)


@contextlib.contextmanager
def without_interrupt() -> Iterator[None]:
    """Block Ctrl-C in processes that are started meanwhile; this process receives it afterwards."""
    resource_tracker.ensure_running()  # starting it would unblock the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def with_environment(variables: Mapping[str, str | None]) -> Iterator[None]:
    """Set environment variables, or remove those that are None, for processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in variables}
    _set_variables(variables)
    try:
        yield
    finally:
        _set_variables(before)


def _set_variables(variables: Mapping[str, str | None]) -> None:
    for name, value in variables.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


@contextlib.contextmanager
def _light_main() -> Iterator[None]:
    """Hide the main script from the child, which would otherwise import it again."""
    main = sys.modules["__main__"]
    hidden: dict[str, Any] = {n: main.__dict__.pop(n) for n in ("__file__", "__spec__") if n in main.__dict__}
    main.__spec__ = None
    try:
        yield
    finally:
        main.__dict__.update(hidden)


def peak_mb() -> float:
    """Largest resident size of this process so far, in MB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)
