"""Puts off the import of libraries that other libraries import and that are seldom used."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import ModuleType

#: scikit-learn imports both, and its base classes use neither; together they take longer than all the rest.
LATE = ("pandas", "scipy.stats")


class _Late(MetaPathFinder):
    """Finds the modules of :data:`LATE`, which are executed when an attribute is first asked for."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        spec = PathFinder.find_spec(fullname, path, target) if fullname in LATE else None
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec


def import_late() -> None:
    """Have every later import of a module of :data:`LATE` wait until the module is used."""
    if not any(isinstance(finder, _Late) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Late())
