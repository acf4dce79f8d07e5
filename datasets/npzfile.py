"""NumPy archives from strangers: sizes checked before memory is taken, no pickled objects."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from datasets.body import DatasetError, MissingData

LARGEST = 2**31  # bytes of one array, its numbers in double precision


def read_npz(path: Path, names: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz file.

    Parameters
    ----------
    path : Path
    names : collection of str, optional
        Those that are read where they are there; all by default.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If it cannot be read, an array holds objects, is too large or not as large as it says.
    """
    if not path.is_file():
        raise MissingData(f"{path} is not there; set NRSFM_DATA to its folder")
    try:
        with zipfile.ZipFile(path) as archive:
            held = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            return {name: _array(archive, info) for name, info in held.items() if names is None or name in names}
    except (OSError, EOFError, ValueError, TypeError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        reason = " ".join(str(error).split())
        raise DatasetError(f"{path}: not a readable .npz file ({reason}); write or fetch it again") from None


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(info) as stream:
        version = npy.read_magic(stream)
        read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
        if read is None:
            raise ValueError(f"{info.filename!a} is of an unknown version")
        shape, fortran, kind = read(stream)
        size = math.prod(shape) * kind.itemsize
        if kind.hasobject:
            raise ValueError(f"{info.filename!a} holds objects")
        if max(size, 8 * math.prod(shape)) > LARGEST or min(shape, default=0) < 0:
            raise ValueError(f"{info.filename!a} claims {size} bytes")
        data = stream.read(size + 1)
    if len(data) != size:
        raise ValueError(f"{info.filename!a} does not hold as many numbers as it says")
    return np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C")
