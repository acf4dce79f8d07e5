"""MATLAB files from strangers: sizes checked before memory is taken, one clear line when something is off.

Numeric arrays alone are read, by the published format and in plain numpy: scipy's reader ends the process on some
damaged files. Version 4 is what the three oldest sequences are in.

References
----------
MathWorks, "MAT-File Format".
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.readers.limits import LARGEST, allowance, claim, reason
from nrsfm.datasets.readers.matfile73 import is_mat73, read_mat73

HEAD = 4096  # bytes that hold an array's class, size and name


MATRIX, COMPRESSED = 14, 15


STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}


STORED4 = {0: "<f8", 1: "<f4", 2: "<i4", 3: "<i2", 4: "<u2", 5: "u1"}


CLASSES = {1: "cell", 2: "struct", 3: "object", 4: "char", 5: "sparse"}


NUMERIC = range(6, 16)


class _Damaged(Exception):
    """What is wrong, in a few words."""


def read_mat(path: Path, names: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Array]:
    """Read numeric arrays from a MATLAB file (versions 4, 5 and 7.3).

    Parameters
    ----------
    path : Path
        The file.
    names : sequence of str
        Fields wanted; all must be there.
    optional : sequence of str
        Fields that are read where they are there.

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
        raise MissingData(f"{path} is not there; fetch it with 'nrsfm data get' or set NRSFM_DATA to its folder")
    wanted = [*names, *optional]
    try:
        arrays, found = (read_mat73 if is_mat73(path) else _read)(path, wanted)
    except (OSError, zlib.error, _Damaged) as error:
        raise DatasetError(
            f"{path}: not a readable MATLAB file ({reason(error)}); write it again, or fetch it with 'nrsfm data get'"
        ) from None
    for name in names:
        if name not in arrays:
            held = ", ".join(ascii(name[:40])[1:-1] for name in found[:20]) or "nothing"
            raise DatasetError(f"{path}: field {name} is missing (the file holds {held}); is it the right file?")
    return arrays


def _read(path: Path, names: Sequence[str]) -> tuple[dict[str, Array], list[str]]:
    """Those of the wanted arrays that a file of version 4 or 5 holds, and the names of all that it holds."""
    found: list[str] = []
    arrays: dict[str, Array] = {}
    room = allowance(path)
    if path.stat().st_size > 2 * LARGEST:
        raise _Damaged(f"it is larger than {2 * LARGEST >> 30} GiB")
    for field in _fields(memoryview(path.read_bytes())):
        found.append(field.name)
        if field.name not in names:
            continue
        if field.name in arrays:
            raise _Damaged(f"field {field.name} is there twice")
        if field.size > room:
            raise DatasetError(f"{path}: field {field.name} {claim(field.size)}")
        if field.kind:
            raise DatasetError(f"{path}: field {field.name} is of type {field.kind}, wanted numbers")
        values = field.values()
        if values.size * 8 != field.size:
            raise _Damaged(f"field {field.name} does not hold as many numbers as it says")
        try:
            with np.errstate(all="ignore"):  # odd NaN
                arrays[field.name] = values.astype(float).reshape(field.shape, order="F")
        except ValueError:  # no numbers, in more rows than there can be
            raise _Damaged(f"field {field.name} has an impossible shape") from None
        room -= field.size
    return arrays, found


@dataclass(frozen=True)
class _Field:
    """An array before its numbers are read; ``kind`` is what it is where it is not numeric."""

    name: str
    shape: tuple[int, ...]
    kind: str
    values: Callable[[], NDArray[Any]]

    @property
    def size(self) -> int:
        return 8 * math.prod(self.shape)


def _fields(content: memoryview) -> Iterator[_Field]:
    if bytes(content[124:128]) in (b"\x00\x01IM", b"\x01\x00MI"):
        order = "<" if content[126] == ord("I") else ">"
        for kind, data in _elements(content[128:], order):
            if kind not in (MATRIX, COMPRESSED):
                raise _Damaged(f"it holds an element of type {kind}")
            yield _field5(data, order, kind == COMPRESSED)
    elif len(content) >= 20 and not any(content[:4][k] for k in (1, 2, 3)) and content[0] < 60:
        yield from _fields4(content)
    else:
        raise _Damaged("its head is that of neither version 4 nor 5")


def _fields4(content: memoryview) -> Iterator[_Field]:
    while len(content):
        if len(content) < 20:
            raise _Damaged("it is cut short")
        mopt, rows, columns, imaginary, length = np.frombuffer(content[:20], "<i4").tolist()
        code, kind = STORED4.get(mopt // 10 % 10, ""), {0: "", 1: "char", 2: "sparse"}.get(mopt % 10, "unknown")
        if not code or mopt // 100 or min(rows, columns, length) < 0:
            raise _Damaged("an array has no head")
        start = 20 + length
        size = rows * columns * np.dtype(code).itemsize
        data = content[start : start + size]
        name = bytes(content[20:start]).decode("latin-1").rstrip("\0")
        shape, kind = (rows, columns), "complex" if imaginary else kind
        yield _Field(
            name, shape, kind, partial(np.frombuffer, data[: len(data) - len(data) % np.dtype(code).itemsize], code)
        )
        if len(data) < size:
            raise _Damaged("it is cut short")
        content = content[start + size * (2 if imaginary else 1) :]


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and content of one element after the other."""
    while len(data) >= 8:
        first, second = np.frombuffer(data[:8], order + "u4").tolist()
        if first >> 16:  # at most four bytes, kept in the tag itself
            kind, size, start, step = first & 0xFFFF, first >> 16, 4, 8
        else:
            kind, size, start = first, second, 8
            step = 8 + size + (-size % 8 if kind != COMPRESSED else 0)
        if start + size > len(data) or (start == 4 and size > 4):
            raise _Damaged("it is cut short")
        yield kind, data[start : start + size]
        data = data[step:]


def _inflate(data: memoryview, limit: int) -> memoryview:
    """The first bytes of a compressed array, without its tag."""
    return memoryview(zlib.decompressobj().decompress(data, limit))[8:]


def _field5(data: memoryview, order: str, compressed: bool) -> _Field:
    parts = list(islice(_elements(_inflate(data, HEAD) if compressed else data, order), 3))
    if [kind for kind, _ in parts] != [6, 5, 1]:
        raise _Damaged("an array has no head")
    flags, sizes, name = (part for _, part in parts)
    if len(flags) != 8 or len(sizes) % 4 or not 8 <= len(sizes) <= 32:
        raise _Damaged("an array's head is damaged")
    word = int(np.frombuffer(flags[:4], order + "u4")[0])
    shape = tuple(np.frombuffer(sizes, order + "i4").tolist())
    if min(shape) < 0:
        raise _Damaged("an array's size is negative")
    kind = "" if word & 0xFF in NUMERIC else CLASSES.get(word & 0xFF, "unknown")

    def values() -> NDArray[Any]:
        body = _inflate(data, 8 * math.prod(shape) + HEAD) if compressed else data
        code, numbers = next(islice(_elements(body, order), 3, None), (0, memoryview(b"")))
        if code not in STORED or len(numbers) % np.dtype(STORED[code]).itemsize:
            raise _Damaged("its numbers are of no known type")
        return np.frombuffer(numbers, order + STORED[code])

    return _Field(bytes(name).decode("latin-1"), shape, "complex" if word & 0x800 else kind, values)
