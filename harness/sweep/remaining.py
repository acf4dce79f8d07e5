"""How long a sweep still takes."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import fmean


class Remaining:
    """Tells the time left from the trials that have ended.

    A trial that is left is worth what ended ones of its method took on average. Where none of its method has ended, it
    is worth the average of all, or more as soon as one at work has taken more, and the time left is not ``sure``. The
    pace is how much of that the sweep got through since its first trial began; how many workers there are,
    and what a trial costs besides, is in it. Trials done before the sweep tell what trials take and are none of its
    pace.

    Parameters
    ----------
    methods : mapping of str to str
        The method of every trial, by key.
    """

    def __init__(self, methods: Mapping[str, str]) -> None:
        self._methods = methods
        self._left = dict.fromkeys(methods)
        self._took: dict[str, list[float]] = {}
        self._done = 0.0
        self._began: float | None = None
        self._running: dict[str, float] = {}

    def ended(self, key: str, seconds: float | None, now: float, *, ran: bool) -> None:
        """A trial has ended and took so long; ``ran`` in this sweep, or was done before."""
        self._left.pop(key, None)
        self._running.pop(key, None)
        if seconds is not None:
            self._took.setdefault(self._methods[key], []).append(seconds)
            if ran:
                self._done += seconds
                self._begin(now - seconds)

    def running(self, keys: Mapping[str, object], now: float) -> None:
        """These are at work now."""
        self._running = {key: self._running.get(key, now) for key in keys if key in self._left}
        if self._running:
            self._begin(now)

    def since(self, key: str, now: float) -> float:
        """Seconds that a trial has been at work."""
        return now - self._running.get(key, now)

    def seconds(self, now: float) -> float | None:
        """What is left; None as long as nothing can be said."""
        if not self._took or self._began is None:
            return 0.0 if not self._left else None
        mean = {method: fmean(took) for method, took in self._took.items()}
        spent = {key: now - start for key, start in self._running.items()}
        unknown = {self._methods[key] for key in self._left} - mean.keys()
        if unknown:
            other = fmean(seconds for took in self._took.values() for seconds in took)
            mean |= dict.fromkeys(unknown, other)
            for key, seconds in spent.items():
                if (method := self._methods[key]) in unknown:
                    mean[method] = max(mean[method], seconds)
        worth = {key: mean[self._methods[key]] for key in self._left}
        rest = {key: max(value - spent.get(key, 0.0), 0.0) for key, value in worth.items()}
        through = self._done + sum(spent.values())
        if through <= 0:
            return None
        return max(sum(rest.values()) * (now - self._began) / through, max(rest.values(), default=0.0))

    @property
    def sure(self) -> bool:
        """Whether a trial of every method that is left has ended."""
        return all(self._methods[key] in self._took for key in self._left)

    def _begin(self, start: float) -> None:
        self._began = start if self._began is None else min(start, self._began)
