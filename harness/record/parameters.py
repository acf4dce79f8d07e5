"""Nested settings as flat parameters with dotted names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def flatten(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Leaves of nested settings by dotted name: ``{"method": {"alpha": 800.0}}`` gives ``{"method.alpha": 800.0}``.

    An empty mapping has no leaves and disappears; lists are leaves.
    """
    flat: dict[str, Any] = {}
    for name, value in tree.items():
        if isinstance(value, Mapping):
            flat |= {f"{name}.{inner}": leaf for inner, leaf in flatten(value).items()}
        else:
            flat[str(name)] = value
    return flat
