"""Benchmark harness for multi-body non-rigid structure from motion.

:func:`load` reads tracks, :func:`solve` reconstructs them, and :func:`results` gives finished trials as a table.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nrsfm.harness.solving.solution import Solution
    from nrsfm.harness.solving.solve import load, solve
    from nrsfm.harness.tracking.results import results

    __version__: str

#: Public names and the modules that define them, imported when a name is first used.
_HOMES = {
    "Solution": "nrsfm.harness.solving.solution",
    "load": "nrsfm.harness.solving.solve",
    "results": "nrsfm.harness.tracking.results",
    "solve": "nrsfm.harness.solving.solve",
}

__all__ = ["Solution", "__version__", "load", "results", "solve"]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that ``import nrsfm`` stays quick."""
    if name == "__version__":
        from importlib.metadata import version

        return version("nrsfm")
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'nrsfm' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
