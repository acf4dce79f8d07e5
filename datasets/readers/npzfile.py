"""NumPy files (.npz, .npy) from strangers: sizes are checked before memory is taken, and nothing is unpickled."""

from __future__ import annotations

import math
import warnings
import zipfile
from collections.abc import Callable, Collection
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from nrsfm.datasets.errors import DatasetError, existing
from nrsfm.datasets.readers.limits import allowance, claim, reason

PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # those of numpy; others take memory that no header states


def read_npz(path: Path, names: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz file: all, or those of ``names`` that it holds.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If it cannot be read, or an array holds objects, is too large or not of the size that it states.
    """
    arrays: dict[str, NDArray[Any]] = {}
    room = allowance(existing(path, "set NRSFM_DATA to the folder that holds {folder}/"))

    def take(name: str, stream: IO[bytes]) -> None:
        nonlocal room
        if names is None or name in names:
            arrays[name] = _array(f"{name}.npy", stream, room)
            room -= max(arrays[name].nbytes, 8 * arrays[name].size)

    _each(path, take)
    return arrays


def list_npz(path: Path) -> dict[str, str]:
    """Name, and type and shape in words, of each array of an .npz file; errors as :func:`read_npz`."""
    held: dict[str, str] = {}

    def take(name: str, stream: IO[bytes]) -> None:
        try:
            shape, _, kind = _head(name, stream)
        except ValueError:  # some other file
            held[name] = ""
        else:
            held[name] = f"{kind} {shape}"

    _each(existing(path), take)
    return held


def read_npy(path: Path) -> NDArray[Any]:
    """The array of an .npy file; errors as :func:`read_npz`."""
    room = allowance(existing(path))
    try:
        with path.open("rb") as stream, warnings.catch_warnings(action="error"):
            return _array(path.name, stream, room)
    except Exception as error:
        raise DatasetError(f"{path}: not a readable .npy file ({reason(error)}); write it again") from None


def _each(path: Path, take: Callable[[str, IO[bytes]], None]) -> None:
    """Call ``take`` with the name and the stream of each array of an archive."""
    seen = set()
    try:
        with zipfile.ZipFile(path) as archive, warnings.catch_warnings(action="error"):
            for info in archive.infolist():
                name = info.filename.removesuffix(".npy")
                if name in seen:
                    raise ValueError(f"{info.filename!a} is stored twice")
                seen.add(name)
                if info.compress_type not in PLAIN:
                    raise ValueError(f"{info.filename!a} is compressed in another way than numpy does")
                with archive.open(info) as stream:
                    take(name, stream)
    except Exception as error:  # whatever zipfile, zlib and numpy make of damaged bytes
        raise DatasetError(f"{path}: not a readable .npz file ({reason(error)}); write or fetch it again") from None


def _head(name: str, stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether in Fortran's order, and type of an array; ValueError if the version is unknown."""
    version = npy.read_magic(stream)
    read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
    if read is None:
        raise ValueError(f"{name!a} is of an unknown version")
    return read(stream)


def _array(name: str, stream: IO[bytes], room: int) -> NDArray[Any]:
    """One array; ValueError if it may not be read or takes more than ``room`` bytes."""
    shape, fortran, kind = _head(name, stream)
    size = math.prod(shape) * kind.itemsize
    numbers = 8 * math.prod(shape)  # in double precision
    if kind.hasobject:
        raise ValueError(f"{name!a} holds objects")
    if min(shape, default=0) < 0 or max(size, numbers) > room:
        raise ValueError(f"{name!a} {claim(max(size, numbers))}")
    data = stream.read(size + 1)
    if len(data) != size:
        raise ValueError(f"{name!a} does not hold as many numbers as it states")
    return np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C")
