"""Trials, and tracks of one's own in five lines: ``load``, ``solve``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.solution import Solution, load, solve

__all__ = ["Solution", "load", "solve"]


def __getattr__(name: str) -> Any:
    """What Python users need, imported when it is asked for."""
    if name in __all__:
        from harness import solution

        return getattr(solution, name)
    raise AttributeError(f"module 'harness' has no attribute {name!r}")
