"""Files that anyone may have written: read up to a size limit, checked field by field, their errors on one line."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.text import one_line

if TYPE_CHECKING:
    from pydantic import TypeAdapter, ValidationError

T = TypeVar("T")


def read_bounded(path: Path, largest: int, remedy: str = "") -> bytes:
    """The contents of a regular file of at most ``largest`` bytes.

    Raises UsageError if it is missing, which ``remedy`` ends, larger, unreadable or no regular file.
    """
    without_waiting = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)  # a pipe without a writer
    try:
        with os.fdopen(os.open(path, without_waiting), "rb") as stream:
            if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                raise UsageError(f"{path} is not a regular file")
            content = stream.read(largest + 1)
    except FileNotFoundError:
        raise UsageError(f"{path} is missing" + (f"; {remedy}" if remedy else "")) from None
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    if len(content) > largest:
        raise UsageError(f"{path} is larger than {largest >> 20} MiB")
    return content


def checked(kind: Callable[..., T], text: str | bytes) -> T:
    """The dataclass ``kind`` that a JSON object holds; ValueError, one line, names the first field of another type."""
    from pydantic import ValidationError

    try:
        value: T = _validator(kind).validate_json(text, strict=True)
    except ValidationError as error:
        raise ValueError(first_error(error)) from None
    return value


@cache
def _validator(kind: Any) -> TypeAdapter[Any]:
    """Made when the first text is read, because importing pydantic takes 0.1 s."""
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def first_error(error: ValidationError) -> str:
    """The first error of a validation on one line: ``rows[1].level is '0': input should be a valid number``."""
    first = error.errors(include_url=False)[0]
    place = ""
    for step in first["loc"]:
        place += f"[{step}]" if isinstance(step, int) else f".{step}" if place else step
    place = one_line(place, 100) or "the file"
    if first["type"] == "missing":
        return f"{place} is missing"
    if first["type"] == "extra_forbidden":
        return f"{place} is not a known field"
    message = first["msg"].removeprefix("Value error, ")
    return one_line(f"{place} is {one_line(ascii(first['input']), 60)}: {message[0].lower()}{message[1:]}", 400)
