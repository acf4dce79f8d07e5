"""A typed way to time a call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from pytest_benchmark.fixture import BenchmarkFixture

T = TypeVar("T")


def timed(benchmark: BenchmarkFixture, rounds: int, warmup: int, work: Callable[..., T], *args: Any) -> T:
    """The result of the last of ``rounds`` timed calls, after ``warmup`` calls."""
    result: T = benchmark.pedantic(work, args, rounds=rounds, warmup_rounds=warmup)  # type: ignore[no-untyped-call]
    return result
