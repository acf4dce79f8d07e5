"""Tables in text files from strangers: UTF-8, separated by commas, semicolons, tabs or blanks; lines keep their number.

The csv module splits the lines: pandas' parsers take a line that was cut short for a gap, and need 25 times as long for
a wide file of 29,000 tracks.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.body import Array
from nrsfm.datasets.errors import DatasetError

LINE = 1 << 24  # characters of one line
CHUNK = 1 << 18  # cells that are text at the same time
HEAD = 4  # lines that a layout is recognised by

Row = tuple[int, list[str]]  # number of the line, from 1 on, and its cells


@dataclass(frozen=True)
class Table:
    """The lines of a file: the first ones, and all of them."""

    path: Path
    separator: str
    head: list[list[str]]  # stripped
    rows: Iterator[Row]

    def chunks(self, skip: int) -> Iterator[tuple[list[int], list[list[str]]]]:
        """Numbers and cells behind the first ``skip`` lines, :data:`CHUNK` cells at a time.

        Raises DatasetError where a line has more or fewer cells than the first one.
        """
        width = len(self.head[0])
        rows = islice(self.rows, skip, None)
        while chunk := list(islice(rows, max(1, CHUNK // max(1, width)))):
            for number, row in chunk:
                if len(row) != width:
                    raise DatasetError(
                        f"{self.path}: line {number} has {len(row)} cells and the header {width}; mend the line"
                    )
            yield [number for number, _ in chunk], [row for _, row in chunk]

    def numbers(self, lines: Sequence[int] | NDArray[np.int64], name: str, words: Sequence[str]) -> Array:
        """Finite numbers, NaN where a cell is empty; ``lines`` are the words' lines."""
        if self.separator == ";":  # then a comma can only be a decimal point
            words = [word.replace(",", ".") for word in words]
        values = np.fromiter(map(_number, words), float, len(words))
        if (bad := np.flatnonzero(np.isinf(values))).size:
            wanted = "a finite number, or nothing where it is not observed"
            raise self.misfit(int(lines[bad[0]]), name, words[bad[0]], wanted)
        return values

    def misfit(self, line: int, name: str, word: str, wanted: str) -> DatasetError:
        return DatasetError(f"{self.path}: line {line}: {name} is {word[:40]!a}, wanted {wanted}")


@contextmanager
def opened(path: Path) -> Iterator[Table]:
    """The table of a file; DatasetError if it is no such text, also while it is read."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            lines = _lines(path, stream)
            first = next(lines, "")
            separator = max("\t;,", key=first.count)
            if separator not in first.strip():
                separator = " " if " " in first.strip() else ","
            split = csv.reader(chain([first], lines), delimiter=separator, strict=True, skipinitialspace=True)
            rows = ((number, row) for number, row in enumerate(split, start=1) if row)
            head = list(islice(rows, HEAD))
            stripped = [[word.strip() for word in row] for _, row in head] or [[]]
            yield Table(path, separator, stripped, chain(head, rows))
    except (csv.Error, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DatasetError(f"{path}: not a readable CSV file ({reason}); save it as UTF-8 text with commas") from None


def _lines(path: Path, stream: IO[str]) -> Iterator[str]:
    """Lines of a file; DatasetError if one is longer than :data:`LINE`."""
    while line := stream.readline(LINE):
        if len(line) == LINE:
            raise DatasetError(f"{path}: a line has more than {LINE} characters; it is no table")
        yield line


def _number(word: str) -> float:
    """The value of a word, NaN if it is empty, and infinite if it is no number."""
    try:
        return math.inf if "_" in word else float(word)
    except ValueError:
        return math.inf if word.strip() else math.nan
