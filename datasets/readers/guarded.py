"""Reading a stranger's file in a second process with limits of time and memory.

ezc3d, scipy.io and h5py crash, hang or take memory without end on some damaged files. In the second process
(:mod:`nrsfm.datasets.readers.guarded_child`) that ends the process and not the harness. The arrays come back in an
.npz file.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from nrsfm.datasets.readers import guarded_child
from nrsfm.datasets.readers.guarded_child import Unwanted
from nrsfm.datasets.readers.npzfile import read_npz

SECONDS, SECONDS_PER_MB = 5, 1  # of processor time; reading takes a twentieth of it
BASE_BYTES = 2**30  # of memory, for the process without the file


class Damaged(Exception):
    """A file that cannot be read; the message says why in a few words."""


def read_guarded(kind: str, path: Path, memory: int, *arguments: str | int) -> dict[str, NDArray[Any]]:
    """Arrays of a file, read in a second process.

    Parameters
    ----------
    kind : {"c3d", "mat", "mat73", "h5"}
        The function of :data:`nrsfm.datasets.readers.guarded_child.READERS` that reads it.
    path : Path
    memory : int
        Bytes that the file's content may take.
    arguments : str or int
        Further arguments of that function.

    Raises
    ------
    Damaged
        If the file cannot be read within the limits.
    Unwanted
        If it can be read and does not hold what is wanted.
    """
    seconds = SECONDS + SECONDS_PER_MB * path.stat().st_size // 2**20
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "arrays.npz"
        task = [kind, str(path.absolute()), str(result), seconds, BASE_BYTES + memory, *arguments]
        try:
            process = subprocess.run(
                [sys.executable, "-P", guarded_child.__file__],
                input=json.dumps(task).encode(),
                capture_output=True,
                timeout=20 * seconds,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise Damaged("reading it took too long") from None
        code = process.returncode
        if code in (-signal.SIGXCPU, -signal.SIGKILL):
            raise Damaged("reading it took too long")
        if code < 0:
            raise Damaged(f"reading it ended with signal {-code}")
        if code:
            lines = process.stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
            raise (Unwanted if code == 2 else Damaged)(ascii(lines[-1])[1:-1][:200])
        return read_npz(result)
