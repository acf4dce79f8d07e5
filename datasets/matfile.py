"""MATLAB files from strangers: sizes checked before memory is taken, one clear line when something is off."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy.io

from datasets.body import Array, DatasetError, MissingData

LARGEST = 2**31  # bytes of one array


def read_mat(path: Path, names: Sequence[str]) -> dict[str, Array]:
    """Read numeric arrays from a MATLAB file (version 5).

    Parameters
    ----------
    path : Path
        The file.
    names : sequence of str
        Fields wanted; all must be there.

    Returns
    -------
    dict of float64 arrays

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If it cannot be read, lacks a field, or a field is not numeric or too large.
    """
    if not path.is_file():
        raise MissingData(f"{path} is not there; fetch it with 'harness data get' or set NRSFM_DATA to its folder")
    try:
        held = {name: (shape, kind) for name, shape, kind in scipy.io.whosmat(path)}
        for name in names:
            if name not in held:
                found = ", ".join(held) or "nothing"
                raise DatasetError(f"{path}: field {name} is missing (the file holds {found}); is it the right file?")
            shape, kind = held[name]
            size = int(np.prod([int(n) for n in shape], dtype=object)) * 8
            if size > LARGEST:
                raise DatasetError(f"{path}: field {name} claims {size / 2**30:.0f} GiB; the file is damaged or hostile")
            if kind not in ("double", "single", *(f"{u}int{b}" for u in ("", "u") for b in (8, 16, 32, 64))):
                raise DatasetError(f"{path}: field {name} is of type {kind}, wanted numbers")
        loaded = scipy.io.loadmat(path, variable_names=list(names))
        return {name: np.asarray(loaded[name], dtype=float) for name in names}
    except DatasetError:
        raise
    except MemoryError:
        raise
    except (OSError, ValueError, TypeError, KeyError, IndexError, NotImplementedError, zlib.error, EOFError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise DatasetError(
            f"{path}: not a readable MATLAB 5 file ({reason}); fetch it again with 'harness data get'"
        ) from None
