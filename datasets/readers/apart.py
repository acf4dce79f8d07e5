"""Reads a stranger's file in a process of its own with limits of time and memory (:mod:`nrsfm.datasets.readers.child`)."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from nrsfm.datasets.readers import child
from nrsfm.datasets.readers.npzfile import read_npz

SECONDS_AND_PER_MB = (5, 1)  # of processor time; reading takes a twentieth of it


BASE_BYTES = 2**30  # of memory, for the process without the file


class Damaged(Exception):
    """What is wrong with a file, in a few words."""


class Unwanted(Exception):
    """A file that is whole and not as wanted: which field, and why."""


def read_apart(kind: str, path: Path, memory: int, *words: str) -> dict[str, NDArray[Any]]:
    """What the reader of a kind makes of a file.

    Parameters
    ----------
    kind : {"c3d", "mat73"}
    path : Path
    memory : int
        Bytes that the file's content may take.
    words : str
        What the reader is told besides.

    Raises
    ------
    Damaged, Unwanted
    """
    seconds = SECONDS_AND_PER_MB[0] + SECONDS_AND_PER_MB[1] * path.stat().st_size // 2**20
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "arrays.npz"
        command = [sys.executable, "-P", child.__file__, kind, str(path.absolute()), str(result), str(seconds)]
        command += [str(BASE_BYTES + memory), *words]
        try:
            ended = subprocess.run(command, capture_output=True, timeout=20 * seconds, check=False)
        except subprocess.TimeoutExpired:
            raise Damaged("reading it took too long") from None
        if ended.returncode < 0:
            late = -ended.returncode in (signal.SIGXCPU, signal.SIGKILL)
            raise Damaged("reading it took too long" if late else f"reading it ended with signal {-ended.returncode}")
        if ended.returncode:
            said = ended.stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
            raise (Unwanted if ended.returncode == 2 else Damaged)(ascii(said[-1])[1:-1][:200])
        return read_npz(result)
