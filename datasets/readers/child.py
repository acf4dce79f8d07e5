"""Reads one file with a library that damaged files crash, hang or swell, in a process that may be ended.

Started by :mod:`nrsfm.datasets.readers.apart`: ``python -P child.py KIND FILE RESULT SECONDS BYTES [WORD ...]`` writes RESULT, an
.npz, under these limits of time and memory. It ends with 1 and a line where the file is damaged, with 2 and a line
where it is whole and not as wanted.
"""

from __future__ import annotations

import math
import os
import resource
import sys
from collections.abc import Callable
from itertools import count
from typing import Any

MAT73_NUMERIC = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)} | {"double", "single", "logical"}


HDF5_FILTERS = {1, 2, 3}  # deflate, shuffle, checksum: what MATLAB and h5py write; others are code to load


class Unwanted(Exception):
    """A file that is whole and not as wanted."""


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


def mat73(path: str, room: str, *names: str) -> dict[str, Any]:
    """Those of the named numeric arrays that a MATLAB 7.3 file holds, as ``=NAME``, and ``held``, names of all.

    ``room`` is what the arrays may take, in bytes. What leads out of the file is refused unread.
    """
    os.environ["HDF5_PLUGIN_PRELOAD"] = "::"  # no file makes HDF5 load a library
    import h5py
    import numpy as np

    arrays: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        held = [name for name in file if not name.startswith("#")]
        for name in (name for name in names if name in held):
            free = int(room) - sum(array.nbytes for array in arrays.values())
            arrays[f"={name}"] = _numbers(file, name, free)
    return arrays | {"held": np.array([name[:100] for name in held[:100]], dtype=str)}


def _numbers(file: Any, name: str, free: int) -> Any:
    import h5py
    import numpy as np

    value = file[name] if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
    if not isinstance(value, h5py.Dataset) or value.external or value.is_virtual:
        kind = "a struct or cell" if isinstance(value, h5py.Group) else "not stored in the file itself"
        raise Unwanted(f"field {name} is {kind}, wanted numbers")
    kind = value.attrs.get("MATLAB_class", b"")
    kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
    if kind not in MAT73_NUMERIC or value.dtype.kind not in "fiu" or "MATLAB_sparse" in value.attrs:
        raise Unwanted(f"field {name} is of type {kind or value.dtype}, wanted numbers")
    if "MATLAB_empty" in value.attrs:
        return np.zeros((0, 0))
    each = max(8, value.dtype.itemsize)
    most = each * max(math.prod(value.shape), math.prod(value.chunks or (0,)))
    if most > free:
        amount = f"{most / 2**30:.0f} GiB" if most >= 2**30 else f"{most / 2**20:.0f} MiB"
        raise Unwanted(f"field {name} claims {amount}, more than a file of this size may; it is damaged or hostile")
    stored = value.id.get_create_plist()
    if not HDF5_FILTERS.issuperset(stored.get_filter(k)[0] for k in range(stored.get_nfilters())):
        raise Unwanted(f"field {name} is compressed in another way than MATLAB does; save it anew")
    with np.errstate(all="ignore"):  # odd NaN, and numbers that no double holds
        return np.asarray(value[()], dtype=float).T


READERS: dict[str, Callable[..., dict[str, Any]]] = {"c3d": c3d, "mat73": mat73}


def main(kind: str, path: str, result: str, seconds: int, memory: int, *words: str) -> None:
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # each thread takes memory of its own
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import numpy as np

    np.savez(result, **READERS[kind](path, *words))


if __name__ == "__main__":
    try:
        main(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]), int(sys.argv[5]), *sys.argv[6:])
    except Unwanted as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    except Exception as error:  # whatever the reader or numpy make of damaged bytes
        sys.exit(f"{type(error).__name__}: {' '.join(str(error).split())}")
