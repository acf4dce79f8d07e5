"""MATLAB 7.3 files, which are HDF5, from strangers: what leads out of the file or is too large is refused unread.

References
----------
MathWorks, "MAT-File Versions"; arrays are stored with their dimensions reversed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from datasets.body import Array, DatasetError

SIGNATURE = b"\x89HDF\r\n\x1a\n"
NUMERIC = frozenset(
    {"double", "single", "logical"} | {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
)


def is_mat73(path: Path) -> bool:
    """Whether a file's HDF5 signature stands where MATLAB puts it, behind a head of 512 bytes, or at the start."""
    with path.open("rb") as stream:
        head = stream.read(520)
    return SIGNATURE in (head[512:], head[:8])


def read_mat73(path: Path, names: Sequence[str], largest: int) -> tuple[dict[str, Array], list[str]]:
    """Those of the wanted numeric arrays that a file holds, and the names of all that it holds.

    Parameters
    ----------
    path : Path
    names : sequence of str
    largest : int
        Bytes, as float64, that one array may have.

    Raises
    ------
    DatasetError
        If h5py is not installed, the file is damaged, or a field is not numeric, too large or stored elsewhere.
    """
    try:
        import h5py
    except ImportError:
        raise DatasetError(
            f"{path} is a MATLAB 7.3 file; install h5py to read it (pip install 'nrsfm-harness[mat73]'), or save it "
            "with -v7"
        ) from None
    try:
        with h5py.File(path, "r") as file:
            held = [name for name in file if not name.startswith("#")]
            return {name: _numbers(path, file, name, largest) for name in names if name in held}, held
    except DatasetError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DatasetError(f"{path}: not a readable MATLAB file ({reason}); write or fetch it again") from None


def _numbers(path: Path, file: object, name: str, largest: int) -> Array:
    import h5py

    assert isinstance(file, h5py.File)
    link = file.get(name, getlink=True)
    value = file[name] if isinstance(link, h5py.HardLink) else None
    if not isinstance(value, h5py.Dataset) or value.external or value.is_virtual:
        kind = "a struct or cell" if isinstance(value, h5py.Group) else "not stored in the file itself"
        raise DatasetError(f"{path}: field {name} is {kind}, wanted numbers")
    kind = value.attrs.get("MATLAB_class", b"")
    kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
    if kind not in NUMERIC or value.dtype.kind not in "fiu" or "MATLAB_sparse" in value.attrs:
        raise DatasetError(f"{path}: field {name} is of type {kind or value.dtype}, wanted numbers")
    if 8 * math.prod(value.shape) > largest:
        claim = f"claims {8 * math.prod(value.shape) / 2**30:.0f} GiB"
        raise DatasetError(f"{path}: field {name} {claim}; the file is damaged or hostile")
    if "MATLAB_empty" in value.attrs:
        return np.zeros((0, 0))
    return np.asarray(value[()], dtype=float).T
