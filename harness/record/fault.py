"""Where an exception was raised, in a form that can be shared."""

from __future__ import annotations

import sysconfig
import traceback
from pathlib import Path

#: Packages whose lines say less than the line that called them.
LIBRARIES = frozenset({"numpy", "scipy", "sklearn", "pandas", "joblib", "threadpoolctl"})


def place_of(error: BaseException) -> str:
    """``methods/my_method.py:31``, the innermost line outside of libraries that raised an exception; "" for none.

    Of the file's folders only the last is named, because records are shared.
    """
    frames = [(Path(frame.filename), frame.lineno) for frame in traceback.extract_tb(error.__traceback__)]
    standard = Path(sysconfig.get_path("stdlib"))
    own = [(file, line) for file, line in frames if file.parent != standard and not LIBRARIES & set(file.parts)]
    return f"{own[-1][0].parent.name}/{own[-1][0].name}:{own[-1][1]}" if own else ""
