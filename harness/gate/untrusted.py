"""Reads JSON that somebody else may have written: bounded, strict, and every complaint names file and field."""

from __future__ import annotations

import json
import math
import os
import stat
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, NoReturn

from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.text import one_line

LARGEST = 4 << 20
"""Bytes of a file that is read at all."""


def load(path: Path, remedy: str = "") -> Any:
    """A file's JSON.

    Parameters
    ----------
    path : Path
    remedy : str
        What to do if the file is not there.

    Raises
    ------
    UsageError
        If it is missing, no regular file, larger than 4 MiB, or not strict JSON (a name twice, NaN).
    """
    try:
        without_waiting = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)  # for a pipe's writer
        with os.fdopen(os.open(path, without_waiting), "rb") as stream:
            if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                raise UsageError(f"{path} is not a regular file")
            raw = stream.read(LARGEST + 1)
    except FileNotFoundError:
        raise UsageError(f"{path} is not there" + (f"; {remedy}" if remedy else "")) from None
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    if len(raw) > LARGEST:
        raise UsageError(f"{path} is larger than {LARGEST >> 20} MiB")
    try:
        return json.loads(raw, object_pairs_hook=_object, parse_constant=_constant)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is not valid JSON: {one_line(error)}") from None


def is_date(text: str) -> bool:
    """Whether a text is a day, YYYY-MM-DD."""
    try:
        return date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False


@dataclass(frozen=True)
class Fields:
    """One JSON object of an untrusted file, read field by field.

    Parameters
    ----------
    path : Path
        Its file, for messages.
    data : Any
        The object; anything else is refused.
    where : str
        Where in the file it stands, e.g. ``rows[3]``.
    """

    path: Path
    data: Any
    where: str = ""

    def only(self, wanted: Collection[str], optional: Collection[str] = ()) -> None:
        """Refuse missing fields and unknown ones."""
        self._kind(self.data, dict, self.where or "the file")
        for name in wanted:
            if name not in self.data:
                self.wrong(name, "is missing")
        for name in self.data:
            if name not in wanted and name not in optional:
                self.wrong(name, "is not a field that is known here")

    def text(self, name: str, longest: int = 200, empty: bool = False) -> str:
        value: str = self._kind(self.data[name], str, self.place(name))
        if not value.strip() and not empty:
            self.wrong(name, "is empty")
        if len(value) > longest or not value.isprintable():
            self.wrong(name, f"is longer than {longest} characters or holds control characters")
        return value

    def day(self, name: str) -> str:
        value = self.text(name)
        if not is_date(value):
            self.wrong(name, f"is {value!r}, wanted YYYY-MM-DD")
        return value

    def flag(self, name: str) -> bool:
        value: bool = self._kind(self.data[name], bool, self.place(name))
        return value

    def number(self, name: str) -> float:
        """A finite number, not negative."""
        value = self.data[name]
        try:
            if type(value) in (int, float) and math.isfinite(value) and value >= 0:
                return float(value)
        except OverflowError:
            pass
        return self.wrong(name, f"is {one_line(repr(value), 60)}, wanted a finite number >= 0")

    def count(self, name: str) -> int:
        value = self.data[name]
        if type(value) is int and 0 <= value < 10**9:
            return value
        return self.wrong(name, f"is {one_line(repr(value), 60)}, wanted a whole number >= 0")

    def inner(self, name: str) -> Fields:
        """A field that is an object itself."""
        found = Fields(self.path, self.data[name], self.place(name))
        self._kind(found.data, dict, found.where)
        return found

    def objects(self, name: str) -> Iterator[Fields]:
        """A field that is a list of objects."""
        for i, value in enumerate(self._kind(self.data.get(name, []), list, self.place(name))):
            yield Fields(self.path, value, f"{self.place(name)}[{i}]")

    def texts(self, name: str, longest: int = 200) -> Iterator[str]:
        """A field that is a list of texts."""
        items = self._kind(self.data[name], list, self.place(name))
        inner = Fields(self.path, {str(i): item for i, item in enumerate(items)}, self.place(name))
        for i in inner.data:
            yield inner.text(i, longest)

    def place(self, name: str) -> str:
        return f"{self.where}.{name}" if self.where else name

    def wrong(self, name: str, what: str) -> NoReturn:
        """Refuse the file, naming the field."""
        self._refuse(self.place(name), what)

    def _kind(self, value: Any, kind: type, place: str) -> Any:
        if type(value) is not kind:
            self._refuse(place, f"is not {_KINDS[kind]}")
        return value

    def _refuse(self, place: str, what: str) -> NoReturn:
        raise UsageError(f"{self.path}: {one_line(place, 100)} {one_line(what)}")


_KINDS = {dict: "an object", list: "a list", bool: "true or false", str: "text"}


def _object(items: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(items)
    if len(found) < len(items):
        raise ValueError("a name stands twice in one object")
    return found


def _constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")
