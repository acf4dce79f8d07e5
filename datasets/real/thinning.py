"""Choice of frames and markers of a long take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.errors import DatasetError, check_whole, is_number


@dataclass(frozen=True)
class Thinning:
    """Choice of the frames and markers of a take."""

    video_rate: float | None = None  # frames a second, to which the markers are thinned; None keeps their own rate
    span: Sequence[int] | None = None  # [first, last) in frames of that rate, counted from 0; None takes all
    stride: int | None = None  # None takes the smallest stride that leaves at most ``most`` frames
    most: int = 400  # number of frames at most
    least_seen: float = 0.5  # markers seen in a smaller share of the kept frames, or never, are left out

    def __post_init__(self) -> None:
        for name, value in (("video_rate", self.video_rate), ("least_seen", self.least_seen)):
            if value is not None and not (is_number(value) and value >= 0):
                raise DatasetError(f"dataset.{name} is {value!r}, wanted a number >= 0")
        if self.stride is not None:
            check_whole("dataset.stride", self.stride, 1)
        check_whole("dataset.frames", self.most, 2)

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> Thinning:
        """The thinning of a dataset's settings ``range``, ``stride``, ``frames``, and the others if they are there."""
        return cls(
            video_rate=settings.get("video_rate"),
            span=settings["range"],
            stride=settings["stride"],
            most=settings["frames"],
            least_seen=settings.get("least_seen", 0.0),
        )

    def seen(self, visible: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which markers are kept, (P,), given when each is visible, (F, P)."""
        share = visible.mean(axis=0)
        return np.asarray((share > 0) & (share >= self.least_seen))

    def frames(self, n_frames: int, rate: float) -> slice:
        """The frames that are kept of ``n_frames`` at ``rate`` frames a second, at least two.

        Raises
        ------
        DatasetError
            If the rate is no multiple of the video's, or the span is not within the take.
        """
        step = 1
        if self.video_rate:
            step = round(rate / self.video_rate)
            if step < 1 or abs(step * self.video_rate - rate) > 1e-3 * rate:
                raise DatasetError(
                    f"dataset.video_rate is {self.video_rate:g}, of which the markers' rate {rate:g} is no multiple"
                )
        available = -(-n_frames // step)
        first, last = (0, available) if self.span is None else _span(self.span, available)
        stride = self.stride or -(-(last - first) // self.most)
        if (last - first - 1) // stride < 1:
            raise DatasetError(f"dataset.stride is {stride}, which leaves one of {last - first} frames")
        return slice(first * step, min(n_frames, (last - 1) * step + 1), step * stride)


def _span(span: Sequence[int], available: int) -> tuple[int, int]:
    """First and last frame of a span; DatasetError unless it lies within the available frames."""
    whole = isinstance(span, list | tuple) and [type(k) for k in span] == [int, int]
    if not whole or not 0 <= span[0] < span[1] - 1 < available:
        raise DatasetError(f"dataset.range is {span!r}, wanted [first, last] within 0..{available}")
    return span[0], span[1]
