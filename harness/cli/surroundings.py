"""What a command needs of its process: signs that the terminal can print, short temporary paths, a home."""

from __future__ import annotations

import atexit
import codecs
import io
import os
import shutil
import sys
import tempfile
import traceback
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

STAND_INS: Mapping[str, str] = MappingProxyType(
    {
        "✓": "ok",
        "✗": "no",
        "○": "-",
        "↓": "v",
        "↑": "^",
        "◇": "*",
        "–": "-",
        "±": "+-",
        "×": "x",
        "†": "+",
        "…": "...",
        "“": '"',
        "”": '"',
        "’": "'",
    }
)
"""What stands for a sign on a terminal that does not have it; any other becomes "?"."""
LONGEST = 70
"""Bytes of a temporary folder's path. Sockets are made in it, and their paths have at most 104 or 108 bytes."""


def prepare() -> None:
    """Let standard output and error print any text, keep temporary paths short, and have a home; children inherit both.

    A user whom the system does not know, as in a container, has no home, and MLflow does not load without one.
    """
    codecs.register_error("nrsfm", _stand_in)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="nrsfm")
    if len(os.fsencode(tempfile.gettempdir())) > LONGEST:
        shorter = [name for name in ("/tmp", "/var/tmp") if os.access(name, os.W_OK)]
        if shorter:
            os.environ["TMPDIR"] = tempfile.tempdir = shorter[0]
    try:
        Path.home()
    except RuntimeError:
        os.environ["HOME"] = tempfile.mkdtemp(prefix="nrsfm-home-")
        atexit.register(shutil.rmtree, os.environ["HOME"], ignore_errors=True)


def keep_traceback() -> Path:
    """Write the traceback of the exception that is being handled to a file of its own; returns its path."""
    handle, name = tempfile.mkstemp(prefix="nrsfm-", suffix=".log")
    with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
        traceback.print_exc(file=file)
    return Path(name)


def _stand_in(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(STAND_INS.get(sign, "?") for sign in error.object[error.start : error.end]), error.end
