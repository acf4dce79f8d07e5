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
import sys
import warnings
from collections.abc import Callable
from itertools import count
from typing import Any

from nrsfm.datasets.readers.limits import claim

NUMERIC = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)} | {"double", "single", "logical"}
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
        Each field of ``names`` that the file holds, as float64 under ``=NAME``; and ``names``, those of all fields.

    Raises
    ------
    Unwanted
        If a field is not numeric, or all together take more than ``room`` bytes. Any other exception: a damaged file.
    """
    import numpy as np
    from scipy.io import loadmat, whosmat

    with warnings.catch_warnings(action="error"), np.errstate(all="ignore"):  # odd NaN
        listing = whosmat(path, appendmat=False)
        stored = [name for name, _, _ in listing]
        wanted = [field for field in listing if field[0] in names]
        for name, shape, kind in wanted:
            if stored.count(name) > 1:
                raise ValueError(f"field {name} is there twice")
            if min(shape, default=0) < 0:
                raise ValueError(f"field {name} has a negative size")
            if kind not in NUMERIC:
                raise Unwanted(f"field {name} is of type {kind}, wanted numbers")
            room = _room_left(name, 8 * math.prod(shape), room)
        arrays = loadmat(path, variable_names=[name for name, _, _ in wanted], appendmat=False) if wanted else {}
        for name, _, _ in wanted:
            if arrays[name].dtype.kind not in "fiub":
                raise Unwanted(f"field {name} is of type {arrays[name].dtype}, wanted numbers")
        return {f"={name}": np.asfortranarray(arrays[name], float) for name, _, _ in wanted} | _names(stored)


def mat73(path: str, room: int, *names: str) -> dict[str, Any]:
    """Numeric fields of a MATLAB file of version 7.3, as :func:`mat`. Links and data in other files are refused."""
    os.environ["HDF5_PLUGIN_PRELOAD"] = "::"  # no file makes HDF5 load a library
    import h5py

    arrays: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        stored = [name for name in file if not name.startswith("#")]
        for name in (name for name in names if name in stored):
            arrays[f"={name}"] = _hdf5_numbers(file, name, room)
            room -= arrays[f"={name}"].nbytes
    return arrays | _names(stored)


def _hdf5_numbers(file: Any, name: str, room: int) -> Any:
    """One field of a file of version 7.3, as float64 with MATLAB's order of dimensions."""
    import h5py
    import numpy as np

    value = file[name] if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
    if not isinstance(value, h5py.Dataset) or value.external or value.is_virtual:
        kind = "a struct or cell" if isinstance(value, h5py.Group) else "not stored in the file itself"
        raise Unwanted(f"field {name} is {kind}, wanted numbers")
    kind = value.attrs.get("MATLAB_class", b"")
    kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
    if kind not in NUMERIC or value.dtype.kind not in "fiu" or "MATLAB_sparse" in value.attrs:
        raise Unwanted(f"field {name} is of type {kind or value.dtype}, wanted numbers")
    if "MATLAB_empty" in value.attrs:
        return np.zeros((0, 0))
    each = max(8, value.dtype.itemsize)
    _room_left(name, each * max(math.prod(value.shape), math.prod(value.chunks or (0,))), room)
    stored = value.id.get_create_plist()
    if not HDF5_FILTERS.issuperset(stored.get_filter(k)[0] for k in range(stored.get_nfilters())):
        raise Unwanted(f"field {name} is compressed in another way than MATLAB does; save it anew")
    with np.errstate(all="ignore"):  # odd NaN, and numbers that no double holds
        return np.asarray(value[()], dtype=float).T


def _room_left(name: str, size: int, room: int) -> int:
    """The bytes that are left of ``room`` after a field of ``size`` bytes; Unwanted if there are too few."""
    if size > room:
        raise Unwanted(f"field {name} {claim(size)}")
    return room - size


def _names(stored: list[str]) -> dict[str, Any]:
    """The first names of a file's fields, short, for an error message."""
    import numpy as np

    return {"names": np.array([name[:100] for name in stored[:100]], dtype=str)}


READERS: dict[str, Callable[..., dict[str, Any]]] = {"c3d": c3d, "mat": mat, "mat73": mat73}


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
