"""MATLAB 7.3 files, which are HDF5, from strangers: what leads out of the file or is too large is refused unread.

h5py does the reading, in a process of its own with limits (:mod:`nrsfm.datasets.readers.apart`): damaged files take memory without
end, or never end.

References
----------
MathWorks, "MAT-File Versions"; arrays are stored with their dimensions reversed.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.apart import Damaged, Unwanted, read_apart
from nrsfm.datasets.readers.limits import allowance

SIGNATURE = b"\x89HDF\r\n\x1a\n"


def is_mat73(path: Path) -> bool:
    """Whether a file's HDF5 signature stands where MATLAB puts it, behind a head of 512 bytes, or at the start."""
    with path.open("rb") as stream:
        head = stream.read(520)
    return SIGNATURE in (head[512:], head[:8])


def read_mat73(path: Path, names: Sequence[str]) -> tuple[dict[str, Array], list[str]]:
    """Those of the wanted numeric arrays that a file holds, and the names of all that it holds.

    Parameters
    ----------
    path : Path
    names : sequence of str

    Raises
    ------
    DatasetError
        If h5py is not installed, the file is damaged, or a field is not numeric, too large or stored elsewhere.
    """
    if importlib.util.find_spec("h5py") is None:
        raise DatasetError(
            f"{path} is a MATLAB 7.3 file; install h5py to read it (pip install 'nrsfm[mat73]'), or save it with -v7"
        )
    room = allowance(path)
    try:
        stored = read_apart("mat73", path, 4 * room, str(room), *(name for name in names if "\0" not in name))
    except Unwanted as error:
        raise DatasetError(f"{path}: {error}") from None
    except Damaged as error:
        raise DatasetError(f"{path}: not a readable MATLAB file ({error}); write or fetch it again") from None
    return {name: stored[f"={name}"] for name in names if f"={name}" in stored}, stored["held"].tolist()
