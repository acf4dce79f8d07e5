"""The time left of a sweep."""

from __future__ import annotations

import pytest

from nrsfm.harness.sweep.remaining import Remaining


def sweep(**counts: int) -> Remaining:
    return Remaining({f"{method}{i}": method for method, n in counts.items() for i in range(n)})


def test_nothing_is_said_before_anything_is_known() -> None:
    left = sweep(a=4)
    assert left.seconds(0.0) is None
    left.running({"a0": None}, 1.0)
    assert left.seconds(5.0) is None


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_workers_side_by_side_are_in_the_pace(workers: int) -> None:
    """Of twenty trials of 10 s, ten have ended, so many at a time."""
    left, now = sweep(a=20), 100.0
    for first in range(0, 10, workers):
        now += 10.0
        for i in range(first, first + workers):
            left.ended(f"a{i}", 10.0, now, ran=True)
    assert left.seconds(now) == pytest.approx(100 / workers)
    assert left.sure


def test_what_was_done_before_is_no_pace() -> None:
    """A hundred trials are found done within a moment; the two that are left take as long as those did."""
    left = sweep(a=102)
    for i in range(100):
        left.ended(f"a{i}", 10.0, 0.0, ran=False)
    left.running({"a100": None, "a101": None}, 2.0)
    assert left.seconds(6.0) == pytest.approx(6.0)
    left.ended("a100", 10.0, 12.0, ran=True)
    assert left.seconds(12.0) == pytest.approx(0.0)


def test_every_method_takes_its_own_time() -> None:
    left = sweep(quick=10, slow=2)
    for i in range(10):
        left.ended(f"quick{i}", 1.0, i + 1.0, ran=True)
    assert left.seconds(10.0) == pytest.approx(2.0)  # as the quick ones, for want of better
    assert not left.sure
    left.running({"slow0": None}, 10.0)
    assert left.seconds(40.0) >= 30.0  # one has taken 30 s and goes on: the other will take as long
    left.ended("slow0", 60.0, 70.0, ran=True)
    assert left.sure
    assert left.seconds(70.0) == pytest.approx(60.0)


def test_the_longest_of_the_last_is_waited_for() -> None:
    """Four workers got through eight trials; the one that is left is in one piece."""
    left = sweep(a=9)
    for i in range(8):
        left.ended(f"a{i}", 40.0, 40.0 * (1 + i // 4), ran=True)
    left.running({"a8": None}, 80.0)
    assert left.seconds(90.0) == pytest.approx(30.0)


def test_a_trial_that_takes_longer_than_others_did_is_about_to_end() -> None:
    left = sweep(a=2)
    left.ended("a0", 5.0, 5.0, ran=True)
    left.running({"a1": None}, 5.0)
    assert left.seconds(500.0) == 0.0


def test_in_the_end_nothing_is_left() -> None:
    left = sweep(a=1)
    left.ended("a0", None, 1.0, ran=True)  # lost, and nobody knows how long it took
    assert left.seconds(2.0) == 0.0
