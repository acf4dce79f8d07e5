"""Numbers and arrays as the JSON of a page holds them: rounded, packed, each array once."""

from __future__ import annotations

import base64
import hashlib
import math
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray


@dataclass
class Blobs:
    """Arrays by the digest of their contents, each stored once as ``{kind, shape, scale, data}``.

    Of int16 the differences along the first axis are stored, the low bytes before the high ones: what moves smoothly is
    half as long so. All is deflated.
    """

    held: dict[str, dict[str, Any]] = field(default_factory=dict)

    def add(self, values: NDArray[Any], kind: Literal["int16", "uint8"]) -> str:
        """Store an array and return its name.

        Parameters
        ----------
        values : array
            NaN becomes the least number of int16.
        kind : {"int16", "uint8"}
            The values are scaled to its whole range; uint8 is for values from 0 on.
        """
        top = float(np.nanmax(np.abs(values), initial=0.0)) or 1.0
        steps = {"int16": 32767, "uint8": 255}[kind]
        filled = np.where(np.isnan(values), -(steps + 1) / steps * top, values)  # one step below the least value
        packed = np.round(filled / top * steps).astype(f"<{np.dtype(kind).str[1:]}")
        stored = packed.tobytes()
        if kind == "int16":  # the differences wrap round, as the sums of the reader do
            steps_taken = np.diff(packed, axis=0, prepend=np.zeros_like(packed[:1]))
            stored = np.frombuffer(steps_taken.tobytes(), np.uint8).reshape(-1, 2).T.tobytes()
        name = hashlib.sha256(repr((packed.shape, top)).encode() + packed.tobytes()).hexdigest()[:12]
        self.held[name] = {
            "kind": kind,
            "shape": packed.shape,
            "scale": significant(top / steps),
            "data": deflated(stored),
        }
        return name


def deflated(content: bytes) -> str:
    """Bytes as the pages hold them: zlib in base64, which ``inflate`` of ``player.js`` reads."""
    return base64.b64encode(zlib.compress(content, 9)).decode()


def significant(value: float) -> float:
    """Six significant digits."""
    return float(f"{value:.6g}")


def rounded(values: Iterable[float]) -> list[float | None]:
    """Six significant digits each; None for what is not finite."""
    return [significant(value) if math.isfinite(value) else None for value in values]


def evenly(n: int, most: int) -> NDArray[np.int64]:
    """At most so many of the numbers 0..n-1, evenly spaced, first and last among them."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))
