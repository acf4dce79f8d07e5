"""What ``nrsfm doctor`` looks at, one function each. They change nothing that is there."""

from __future__ import annotations

import shutil
import socket
import sqlite3
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote, urlsplit

import psutil

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.public import catalogue as sources
from nrsfm.harness.config.address import file_of, shown
from nrsfm.harness.config.compose import compose_config
from nrsfm.harness.config.plugins import faults, installed
from nrsfm.harness.config.settings import Settings, read
from nrsfm.harness.doctor.requirements import NOTE, OK, PROBLEM, Finding, plural
from nrsfm.harness.record.environment import cores, environment
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import LEAST
from nrsfm.harness.record.outcome import OK as DONE
from nrsfm.harness.tracking.tracker import EXPERIMENT, Tracker
from nrsfm.harness.trial.execute import execute

GB = 2**30
SCARCE_GB = 2  # of the disk: a sweep of a paper's table with its report takes less
PATIENCE = 3.0  # seconds in which a server must take a connection


def threads(settings: Settings) -> Iterator[Finding]:
    """BLAS, and whether the trials side by side have a core for each of their threads."""
    n_cores, blas = cores(), environment()["blas"]
    workers = settings.workers or n_cores // settings.threads or 1
    each = f"{settings.threads} BLAS {plural('thread', settings.threads)} each"
    text = (
        f"{n_cores} {plural('core', n_cores)}, {blas or 'a BLAS that cannot be told'}; "
        f"{workers} {plural('trial', workers)} side by side, {each}"
    )
    state, remedy = OK, ""
    if not blas:
        state, remedy = NOTE, "its threads cannot be limited: set OMP_NUM_THREADS=1 before nrsfm starts"
    elif workers * settings.threads > n_cores:
        state, text = NOTE, f"{text}: more than there are cores, which may be many times slower"
        remedy = f"take workers={n_cores // settings.threads}" if settings.threads <= n_cores else "take threads=1"
    yield Finding("threads", state, text, remedy)


def memory(settings: Settings) -> Iterator[Finding]:
    """The machine's memory beside what the trials may take."""
    total, free = _memory_gb()
    text = f"{total:.1f} GB, {free:.1f} GB of it free"
    state, remedy, limit = OK, "", f"; a trial may take {settings.memory_gb:g} GB"
    if settings.memory_gb > total:
        state, remedy = NOTE, f"take limits.memory_gb={total:.0f}"
    elif free < 1:
        state, remedy, limit = NOTE, "end other programs, or take workers=1", ""
    yield Finding("memory", state, text + limit, remedy)


def output(settings: Settings) -> Iterator[Finding]:
    """Whether the output folder, or the one in which it will be made, can be written, and the room on its disk."""
    folder = settings.output
    there = next(place for place in (folder, *folder.parents) if place.exists())
    text = str(folder) + ("" if there == folder else ", which the first run makes")
    try:
        with tempfile.TemporaryFile(dir=there) as file:
            file.write(b"x")
            file.flush()
        free = shutil.disk_usage(there).free
    except OSError as error:
        yield Finding("output", PROBLEM, f"{there}: {error.strerror}", "name another folder with NRSFM_OUTPUT")
        return
    text += f"; {free / GB:.1f} GB free"
    state, remedy = OK, ""
    if free < LEAST:
        state, remedy = PROBLEM, "make room, or name another folder with NRSFM_OUTPUT"
    elif free < SCARCE_GB * GB:
        state, remedy = NOTE, "make room before a long sweep"
    yield Finding("output", state, text, remedy)


def store(settings: Settings) -> Iterator[Finding]:
    """The tracker, as a run would use it. One that is not there yet is not made."""
    uri = settings.tracking_uri
    path = file_of(uri)
    name = shown(uri) if path is None else str(path)
    if path is not None and not path.exists():
        yield Finding("store", OK, f"{name}, which the first run makes")
        return
    state, remedy = PROBLEM, "see to tracking.uri; trials run without it, and 'nrsfm sync' brings them in"
    try:
        how = _reached(name) if path is None else _sqlite(path)
        tracker = Tracker(uri, settings.output)
        _ = tracker.deleted()
        begun = time.monotonic()
        deleted = tracker.deleted()
        text = f"{name}: {how}, answers in {1000 * (time.monotonic() - begun):.0f} ms"
        state, remedy = OK, ""
        if deleted:
            state, text = NOTE, f"{text}; its experiment {EXPERIMENT} was deleted in MLflow"
            remedy = "'nrsfm sync' restores it"
    except sqlite3.Error as error:
        text = f"{name}: {error}"
        if "locked" in str(error):
            state, remedy = NOTE, "another process has been writing to it for seconds; ask again"
        else:
            remedy = "see to its permissions, or move it away and let 'nrsfm sync' fill a new one"
    except UsageError as error:
        text = str(error)
    except OSError as error:
        text = f"{name}: {error.strerror or error}"
    yield Finding("store", state, text, remedy)


def data(settings: Settings) -> Iterator[Finding]:
    """The public files, by their checksums, and what else stands in the data folder."""
    folder = settings.data
    try:
        found = sources.verify(folder)
    except DatasetError as error:
        yield Finding("data", PROBLEM, str(error))
        return
    for group in dict.fromkeys(file.group for file, _ in found):
        states = Counter(state for file, state in found if file.group == group)
        right, changed = states[sources.PRESENT], states[sources.CHANGED]
        text = f"{group}: {right} of {states.total()} files, verified"
        state, remedy = NOTE, f"nrsfm data get {group}"
        if changed:
            state, text = PROBLEM, f"{group}: {changed} damaged or other files"
        elif right == states.total():
            state, remedy = OK, ""
        elif not right:
            text = f"{group}: none of {states.total()} files in {folder}"
        yield Finding("data", state, text, remedy)
    known = {file.group for file, _ in found}
    for place in sorted(folder.iterdir()) if folder.is_dir() else ():
        if place.is_dir() and place.name not in known:
            n = sum(1 for _ in place.iterdir())
            yield Finding("data", OK, f"{place.name}: {n} {plural('file', n)}, not of the catalogue")


def packages(settings: Settings) -> Iterator[Finding]:
    """Methods and datasets of other packages. A broken one keeps nothing else from running."""
    wrong = list(faults())
    for fault in wrong:
        text, _, remedy = fault.rpartition("; ")
        yield Finding("packages", NOTE, text or fault, remedy if text else "")
    brought = Counter(entry.dist.name if entry.dist else "?" for entry in installed())
    if brought and not wrong:
        yield Finding("packages", OK, ", ".join(f"{name}: {n} {plural('entry', n)}" for name, n in brought.items()))


def trial(settings: Settings) -> Iterator[Finding]:
    """A tiny trial in a process of its own, as every trial runs; its record is thrown away."""
    words = ["dataset=procedural", "dataset.points=6", "dataset.frames=8", "method=edsc"]
    asked, _ = read(compose_config(words))
    begun = time.monotonic()
    try:
        with tempfile.TemporaryDirectory() as other:
            own = replace(settings, output=Path(other), sweep="", seconds=60.0, memory_gb=4.0)
            outcome, _ = execute(asked, own)
    except Exception as error:  # whatever a system forbids
        reason = f"cannot be isolated: {type(error).__name__}: {' '.join(str(error).split())}"
        yield Finding("trial", PROBLEM, reason, "see whether processes may be forked here")
        return
    text = f"{asked.title} in a process of its own: {outcome.status}"
    if outcome.status == DONE:
        yield Finding("trial", OK, f"{text}, {time.monotonic() - begun:.1f} s")
    else:
        yield Finding("trial", PROBLEM, f"{text}, {outcome.error}", "reinstall numpy, scipy and scikit-learn")


#: In the order in which they are told; the slowest last.
CHECKS: tuple[Callable[[Settings], Iterator[Finding]], ...] = (
    threads, memory, output, data, packages, store, trial,
)  # fmt: skip


def _sqlite(path: Path) -> str:
    """What the store holds, once it has let itself be written to; raises sqlite3.Error if it does not."""
    with closing(sqlite3.connect(f"file:{quote(str(path))}?mode=rw", uri=True, timeout=2)) as db:
        (mode,) = db.execute("PRAGMA journal_mode").fetchone()
        db.execute("BEGIN IMMEDIATE")
        (n,) = db.execute("SELECT count(*) FROM runs JOIN experiments USING (experiment_id)").fetchone()
        db.rollback()
    return f"{n} {plural('run', n)}, journal mode {mode}, writable"


def _reached(uri: str) -> str:
    """Ask a server for a connection; raises OSError if there is none within seconds."""
    parts = urlsplit(uri)
    if parts.scheme not in ("http", "https") or parts.hostname is None:
        return "a database"
    socket.create_connection((parts.hostname, parts.port or (443 if parts.scheme == "https" else 80)), PATIENCE).close()
    return "a server"


def _memory_gb() -> tuple[float, float]:
    """All of this machine's, or this container's, memory and what of it is free, in GB."""
    machine = psutil.virtual_memory()
    total, free = machine.total / GB, machine.available / GB
    for limit, used in (
        ("memory.max", "memory.current"),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
    ):
        try:
            most, now = (int((Path("/sys/fs/cgroup") / name).read_text()) / GB for name in (limit, used))
        except (OSError, ValueError):  # no container, or one without a limit
            continue
        if most < total:
            total, free = most, min(free, most - now)
    return total, free
