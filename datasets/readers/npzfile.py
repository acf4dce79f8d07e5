"""NumPy archives (.npz) from strangers: sizes are checked before memory is taken, and nothing is unpickled."""

from __future__ import annotations

import math
import warnings
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

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
    existing(path, "set NRSFM_DATA to its folder")
    arrays: dict[str, NDArray[Any]] = {}
    room = allowance(path)
    try:
        with zipfile.ZipFile(path) as archive, warnings.catch_warnings(action="error"):
            for info in archive.infolist():
                name = info.filename.removesuffix(".npy")
                if names is not None and name not in names:
                    continue
                if name in arrays:
                    raise ValueError(f"{info.filename!a} is there twice")
                arrays[name] = _array(archive, info, room)
                room -= max(arrays[name].nbytes, 8 * arrays[name].size)
    except Exception as error:  # whatever zipfile, zlib and numpy make of damaged bytes
        raise DatasetError(f"{path}: not a readable .npz file ({reason(error)}); write or fetch it again") from None
    return arrays


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo, room: int) -> NDArray[Any]:
    """One array of an archive; ValueError if it may not be read or takes more than ``room`` bytes."""
    if info.compress_type not in PLAIN:
        raise ValueError(f"{info.filename!a} is compressed in another way than numpy does")
    with archive.open(info) as stream:
        version = npy.read_magic(stream)
        read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
        if read is None:
            raise ValueError(f"{info.filename!a} is of an unknown version")
        shape, fortran, kind = read(stream)
        size = math.prod(shape) * kind.itemsize
        numbers = 8 * math.prod(shape)  # in double precision
        if kind.hasobject:
            raise ValueError(f"{info.filename!a} holds objects")
        if min(shape, default=0) < 0 or max(size, numbers) > room:
            raise ValueError(f"{info.filename!a} {claim(max(size, numbers))}")
        data = stream.read(size + 1)
    if len(data) != size:
        raise ValueError(f"{info.filename!a} does not hold as many numbers as it states")
    return np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C")
