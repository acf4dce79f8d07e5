"""The second process of :mod:`nrsfm.datasets.readers.guarded`: reads one file with a library that may crash on it.

Standard input holds a JSON list: kind, file, result, seconds, bytes and further arguments of the reader. The result is
an .npz file. The exit code is 1 for a file that cannot be read and 2 for one that does not hold what is wanted. The
last line of standard error gives the reason.
"""

from __future__ import annotations

import json
import math
import os
import resource
import struct
import sys
import warnings
import zlib
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

from nrsfm.datasets.readers.limits import claim

NUMBERS = ("double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
CLASSES = ("cell", "struct", "object", "char", "sparse", *NUMBERS, "function")  # of MATLAB, from 1 on
OBJECT = 17  # the class of strings, tables and other objects in files of version 5, which have no size
NUMERIC = {*NUMBERS, "logical"}
HEAD = 1 << 12  # bytes in which the name and the size of a field stand
HDF5_FILTERS = {1, 2, 3}  # deflate, shuffle, checksum: those of MATLAB and h5py; others are code to load


class Unwanted(Exception):
    """A file that can be read and does not hold what is wanted."""


def c3d(path: str) -> dict[str, Any]:
    """Points (F, 3, M), labels, rate and unit of a C3D file."""
    import ezc3d
    import numpy as np

    file = ezc3d.c3d(path)
    point = file["parameters"]["POINT"]
    more = (f"LABELS{k}" for k in count(2))
    labels = list(point["LABELS"]["value"])
    while (name := next(more)) in point:  # a parameter holds 255 labels
        labels += point[name]["value"]
    units = point["UNITS"]["value"]
    return {
        "points": file["data"]["points"][:3].transpose(2, 0, 1),
        "labels": np.array([label.strip() for label in labels], dtype=str),
        "rate": point["RATE"]["value"][0],
        "unit": units[0].strip() if units else "",
    }


def mat(path: str, room: int, *names: str) -> dict[str, Any]:
    """Numeric fields of a MATLAB file of version 4 or 5.

    Returns
    -------
    dict
        Each field of ``names`` that the file holds, as float64 under ``=NAME``; and ``names`` and ``kinds`` of all.

    Raises
    ------
    Unwanted
        If a field is not numeric, or all together take more than ``room`` bytes. Any other exception: a damaged file.
    """
    import numpy as np
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import matfile_version

    with warnings.catch_warnings(action="error"), np.errstate(all="ignore"):  # odd NaN
        version, _ = matfile_version(path, appendmat=False)
        listing = _fields5(path) if version == 1 else whosmat(path, appendmat=False)
        stored = [name for name, _, _ in listing]
        wanted = [field for field in listing if field[0] in names]
        for name, shape, kind in wanted:
            if stored.count(name) > 1:
                raise ValueError(f"field {name} is stored twice")
            if min(shape, default=0) < 0:
                raise ValueError(f"field {name} has a negative size")
            if kind not in NUMERIC:
                raise Unwanted(f"field {name} is of type {kind}, wanted numbers")
            room = _room_left(name, 8 * math.prod(shape), room)
        arrays = loadmat(path, variable_names=[name for name, _, _ in wanted], appendmat=False) if wanted else {}
        for name, _, _ in wanted:
            if arrays[name].dtype.kind not in "fiub":
                raise Unwanted(f"field {name} is of type {arrays[name].dtype}, wanted numbers")
        numbers = {f"={name}": np.asfortranarray(arrays[name], float) for name, _, _ in wanted}
        return numbers | _listed({name: f"{kind} {shape}" if shape else kind for name, shape, kind in listing if name})


def _fields5(path: str) -> list[tuple[str, tuple[int, ...], str]]:
    """Name, size and class of each field of a file of version 5; scipy's ``whosmat`` fails on strings and tables."""
    found: list[tuple[str, tuple[int, ...], str]] = []
    with Path(path).open("rb") as file:
        order = "<" if file.read(128)[126:] == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(f"{order}2I", tag)
            content = file.read(min(size, HEAD))
            file.seek(size - len(content), os.SEEK_CUR)
            if kind == 15:  # compressed, with its own tag
                content = zlib.decompressobj().decompress(content, HEAD)[8:]
            try:
                found.append(_field5(content, order))
            except (StopIteration, struct.error):
                raise ValueError("a field is cut off") from None
    return found


def _field5(content: bytes, order: str) -> tuple[str, tuple[int, ...], str]:
    """Name, size and class of a field; an object has no size, and a class of its own."""
    parts = _elements(content, order)
    (flags,) = struct.unpack_from(f"{order}I", next(parts))
    if flags & 0xFF == OBJECT:
        name, _, word = [next(parts).decode("latin-1") for _ in range(3)]  # a generator would hide the end
        return name, (), word
    sizes = next(parts)
    shape = struct.unpack(f"{order}{len(sizes) // 4}i", sizes)
    word = "logical" if flags & 0x200 else dict(enumerate(CLASSES, 1)).get(flags & 0xFF, "unknown")
    return next(parts).decode("latin-1"), shape, word


def _elements(content: bytes, order: str) -> Iterator[bytes]:
    """The data of each element in a field's content."""
    at = 0
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}2I", content, at)
        if kind >> 16:  # at most four bytes, which stand in the tag
            yield content[at + 4 : at + 4 + (kind >> 16)]
            at += 8
        else:
            yield content[at + 8 : at + 8 + size]
            at += 8 + size + -size % 8


def mat73(path: str, room: int, *names: str) -> dict[str, Any]:
    """Numeric fields of a MATLAB file of version 7.3, as :func:`mat`. Links and data in other files are refused."""
    os.environ["HDF5_PLUGIN_PRELOAD"] = "::"  # no file makes HDF5 load a library
    import h5py
    import numpy as np

    arrays: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        stored = {name: _hdf5_kind(file, name) for name in file if not name.startswith("#")}
        for name in (name for name in names if name in stored):
            if "MATLAB_empty" in (value := _hdf5_stored(file, name)).attrs:
                arrays[f"={name}"] = np.zeros((0, 0))
                continue
            kind = stored[name].partition(" ")[0]
            is_matlabs = "MATLAB_class" in value.attrs
            if (is_matlabs and kind not in NUMERIC) or value.dtype.kind not in "fiu" or "MATLAB_sparse" in value.attrs:
                raise Unwanted(f"field {name} is of type {kind}, wanted numbers")
            arrays[f"={name}"] = _hdf5_numbers(name, value, room).T  # MATLAB's order of dimensions
            room -= arrays[f"={name}"].nbytes
    return arrays | _listed(stored)


def h5(path: str, room: int, *names: str) -> dict[str, Any]:
    """Arrays of numbers and of words in an HDF5 file of another program, as :func:`mat73`, and MATLAB's too."""
    os.environ["HDF5_PLUGIN_PRELOAD"] = "::"
    import h5py
    import numpy as np

    arrays: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        stored = {name: _hdf5_kind(file, name) for name in file}
        if any("MATLAB_class" in file[name].attrs for name, kind in stored.items() if kind not in ("link", "group")):
            return mat73(path, room, *names)
        for name in (name for name in names if name in stored):
            value = _hdf5_stored(file, name)
            if h5py.check_string_dtype(value.dtype) is None:
                arrays[f"={name}"] = _hdf5_numbers(name, value, room)
                room -= arrays[f"={name}"].nbytes
            else:
                _room_left(name, 400 * math.prod(value.shape), room)
                arrays[f"={name}"] = np.array([word[:100] for word in value.asstr()[()].ravel()], dtype=str)
    return arrays | _listed(stored)


def _hdf5_stored(file: Any, name: str) -> Any:
    """A dataset that is stored in the file itself."""
    import h5py

    value = file[name] if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
    if not isinstance(value, h5py.Dataset) or value.external or value.is_virtual:
        kind = "a struct or cell" if isinstance(value, h5py.Group) else "not stored in the file itself"
        raise Unwanted(f"field {name} is {kind}, wanted numbers")
    return value


def _hdf5_kind(file: Any, name: str) -> str:
    """Class and shape of what stands under a name."""
    import h5py

    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        return "link"
    value = file[name]
    if not isinstance(value, h5py.Dataset):
        return "group"
    kind = value.attrs.get("MATLAB_class", b"")
    kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
    shape = value.shape[::-1] if kind else value.shape
    return f"{(kind or str(value.dtype)).replace(' ', '')} {shape}"


def _hdf5_numbers(name: str, value: Any, room: int) -> Any:
    """A dataset as float64."""
    import numpy as np

    if value.dtype.kind not in "fiub":
        raise Unwanted(f"field {name} is of type {value.dtype}, wanted numbers")
    each = max(8, value.dtype.itemsize)
    _room_left(name, each * max(math.prod(value.shape), math.prod(value.chunks or (0,))), room)
    stored = value.id.get_create_plist()
    if not HDF5_FILTERS.issuperset(stored.get_filter(k)[0] for k in range(stored.get_nfilters())):
        raise Unwanted(f"field {name} is compressed in another way than MATLAB does; save it anew")
    with np.errstate(all="ignore"):  # odd NaN, and numbers that no double holds
        return np.asarray(value[()], dtype=float)


def _room_left(name: str, size: int, room: int) -> int:
    """The bytes that are left of ``room`` after a field of ``size`` bytes; Unwanted if there are too few."""
    if size > room:
        raise Unwanted(f"field {name} {claim(size)}")
    return room - size


def _listed(stored: dict[str, str]) -> dict[str, Any]:
    """The first names of a file's fields, short, and their classes and sizes: for messages."""
    import numpy as np

    first = list(stored.items())[:100]
    words = zip(("names", "kinds"), zip(*first, strict=True) if first else ((), ()), strict=True)
    return {key: np.array([word[:100] for word in values], dtype=str) for key, values in words}


READERS: dict[str, Callable[..., dict[str, Any]]] = {"c3d": c3d, "mat": mat, "mat73": mat73, "h5": h5}


def main(kind: str, path: str, result: str, seconds: int, memory: int, *arguments: str | int) -> None:
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # each thread takes memory of its own
    for kind_of_limit, soft, hard in (
        (resource.RLIMIT_CPU, seconds, seconds + 1),
        (resource.RLIMIT_AS, memory, memory),
        (resource.RLIMIT_CORE, 0, 0),
    ):
        present = resource.getrlimit(kind_of_limit)[1]
        most = hard if present == resource.RLIM_INFINITY else min(hard, present)
        resource.setrlimit(kind_of_limit, (min(soft, most), most))
    import numpy as np

    np.savez(result, **READERS[kind](path, *arguments))


if __name__ == "__main__":
    try:
        main(*json.load(sys.stdin))
    except Unwanted as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    except MemoryError:
        sys.exit("it claims more memory than a file of this size may; it is damaged or hostile")
    except Exception as error:  # whatever the libraries raise on damaged bytes
        sys.exit(f"{type(error).__name__}: {' '.join(str(error).split())}")
