"""MATLAB files of versions 4, 5 and 7.3: numeric fields, with one clear line about a file that cannot be used.

HDF5 files of other programs that end in .mat are read as well, their arrays as they are: MATLAB alone stores the
dimensions in the opposite order.

scipy.io and h5py do the reading. Files from strangers are read in a guarded process
(:mod:`nrsfm.datasets.readers.guarded`), which takes about 0.3 s. Files of the catalogue, known by their SHA-256, are
read in this process.

References
----------
MathWorks, "MAT-File Format" and "MAT-File Versions".
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError, existing
from nrsfm.datasets.public.catalogue import CATALOGUE, sha256
from nrsfm.datasets.readers import guarded_child
from nrsfm.datasets.readers.guarded import Damaged, read_guarded
from nrsfm.datasets.readers.guarded_child import Unwanted
from nrsfm.datasets.readers.limits import allowance, reason

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
OCTAVE = (b"# Created by Octave", b"Octave-1-")  # its format of text, and its binary one


def read_mat(path: Path, names: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Array]:
    """Numeric fields of a MATLAB file as float64 arrays: all of ``names``, and those of ``optional`` that it holds.

    Raises
    ------
    MissingData
        If the file is not there.
    DatasetError
        If it cannot be read, lacks a field, or a field is not numeric or too large; if h5py is not installed and the
        file is of version 7.3.
    """
    arrays, held = mat_fields(path, [*names, *optional])
    for name in names:
        if name not in arrays:
            raise DatasetError(f"{path}: field {name} is missing ({listed(held)}); is it the right file?")
    return arrays


def mat_fields(path: Path, names: Sequence[str]) -> tuple[dict[str, Array], dict[str, str]]:
    """Those of ``names`` that a file holds, and the class and size in words of all its fields; see :func:`read_mat`."""
    room = allowance(existing(path))
    try:
        if _is_known(path):
            stored = guarded_child.mat(str(path), room, *names)
        else:
            stored = read_guarded(_kind(path), path, 4 * room, room, *names)
    except Unwanted as error:
        raise DatasetError(f"{path}: {reason(error)}") from None
    except (OSError, Damaged) as error:
        raise DatasetError(
            f"{path}: not a readable MATLAB file ({reason(error)}); write it again, or fetch it with 'nrsfm data get'"
        ) from None
    held = dict(zip(stored["names"].tolist(), stored["kinds"].tolist(), strict=True))
    return {name: stored[f"={name}"] for name in names if f"={name}" in stored}, held


def listed(held: Mapping[str, str]) -> str:
    """Words such as ``the file holds W, double (528, 116)``."""
    words = [ascii(f"{name[:40]}, {kind[:40]}" if kind else name[:40])[1:-1] for name, kind in held.items()][:20]
    return f"the file holds {'; '.join(words) or 'nothing'}"


@cache
def _known_digests() -> frozenset[str]:
    return frozenset(file.sha256 for file in CATALOGUE.values() if file.path.endswith(".mat"))


def _is_known(path: Path) -> bool:
    """Whether a file has the SHA-256 of one of the catalogue's MATLAB files, none of which is of version 7.3."""
    return sha256(path) in _known_digests()


def _kind(path: Path) -> str:
    """The reader: ``mat73`` behind MATLAB's head of 512 bytes, ``h5`` for HDF5 of another program, else ``mat``."""
    with path.open("rb") as stream:
        head = stream.read(520)
    if head.startswith(OCTAVE):
        raise DatasetError(f"{path} is in a format of Octave's own; save it there with: save -v7 {path.name} ...")
    if HDF5_SIGNATURE not in (head[512:], head[:8]):
        return "mat"
    if importlib.util.find_spec("h5py") is None:
        raise DatasetError(
            f"{path} is a MATLAB 7.3 file; install h5py to read it (pip install 'nrsfm[mat73]'), or save it with -v7"
        )
    return "h5" if head.startswith(HDF5_SIGNATURE) else "mat73"
