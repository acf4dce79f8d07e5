"""Errors about input data, and checks that raise them."""

from __future__ import annotations

import math
from numbers import Integral
from pathlib import Path

FETCH = "fetch it with 'nrsfm data get' or set NRSFM_DATA to the folder that holds {folder}/"


class DatasetError(ValueError):
    """Input data that cannot be used. The message is one line: what, where, and the remedy."""


class MissingData(DatasetError):
    """A file that is not there; the message says how to get it."""


def existing(path: Path, remedy: str = FETCH) -> Path:
    """The path of a file that is there; raises MissingData with the remedy, ``{folder}`` its folder, if it is not."""
    if not path.is_file():
        remedy = remedy.replace("{folder}", path.parent.name)
        raise MissingData(f"{path} is not there; {remedy}")
    return path


def check_name(setting: str, name: object) -> None:
    """Raise DatasetError unless a setting is the name of a file without its folder."""
    if not isinstance(name, str) or not name.isprintable() or set(name) & set("/\\:") or not name.strip(". "):
        raise DatasetError(f"{setting} is {str(name)[:80]!a}, wanted the name of a file, without its folder")


def check_whole(setting: str, value: object, least: int, most: int | None = None, remark: str = "") -> None:
    """Raise DatasetError unless a setting is a whole number from ``least`` to ``most``."""
    highest = math.inf if most is None else most
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= highest:
        wanted = f"a whole number of at least {least}" if most is None else f"{least}..{most}"
        raise DatasetError(f"{setting} is {value!r}, wanted {wanted}{remark}")


def is_number(value: object) -> bool:
    """Whether a setting is a finite number, and no truth value."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -math.inf < value < math.inf
