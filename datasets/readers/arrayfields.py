"""The arrays of a file by name, whatever its format: .npz, .npy, .mat and HDF5."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from nrsfm.datasets.errors import DatasetError, existing
from nrsfm.datasets.readers.guarded import Damaged, read_guarded
from nrsfm.datasets.readers.guarded_child import Unwanted
from nrsfm.datasets.readers.limits import allowance, reason
from nrsfm.datasets.readers.matfile import mat_fields
from nrsfm.datasets.readers.npzfile import list_npz, read_npy, read_npz

#: The arrays of some names that a file holds, and the type and shape in words of everything that it holds.
Fields = Callable[[Path, Sequence[str]], tuple[Mapping[str, NDArray[Any]], Mapping[str, str]]]


def npz_fields(path: Path, names: Sequence[str]) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    return read_npz(path, names), list_npz(path)


def npy_fields(path: Path, names: Sequence[str]) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """An .npy file holds one array, which goes by the name ``array``."""
    array = read_npy(path)
    return {"array": array}, {"array": f"{array.dtype} {array.shape}"}


def h5_fields(path: Path, names: Sequence[str]) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Arrays of an HDF5 file, read in a guarded process."""
    room = allowance(existing(path))
    if importlib.util.find_spec("h5py") is None:
        raise DatasetError(f"{path} is an HDF5 file; install h5py to read it: pip install 'nrsfm[mat73]'")
    try:
        stored = read_guarded("h5", path, 4 * room, room, *names)
    except Unwanted as error:
        raise DatasetError(f"{path}: {reason(error)}") from None
    except (OSError, Damaged) as error:
        raise DatasetError(f"{path}: not a readable HDF5 file ({reason(error)}); write it again") from None
    held = dict(zip(stored["names"].tolist(), stored["kinds"].tolist(), strict=True))
    return {name: stored[f"={name}"] for name in names if f"={name}" in stored}, held


FIELDS: Mapping[str, Fields] = {
    ".npz": npz_fields,
    ".npy": npy_fields,
    ".mat": mat_fields,
    ".h5": h5_fields,
    ".hdf5": h5_fields,
}
