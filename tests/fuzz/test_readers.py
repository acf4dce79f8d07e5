"""Any file is read correctly or refused in one line, soon and in little memory.

FUZZ_EXAMPLES is how many files of each kind are tried; by default a few, the same every time. ``make fuzz`` tries many,
and others every time.
"""

from __future__ import annotations

import os
import random
import time
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from nrsfm.datasets.readers.limits import LARGEST, RATIO, SMALL
from tests.fuzz.conftest import COUNTS
from tests.fuzz.mutation import mutated
from tests.fuzz.readers import READERS, refused, seeds
from tests.fuzz.strategies import MADE, changed_json

EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "0"))
FEW = {"apart": 2, "override": 2, "method_yaml": 2}
SECONDS = 20  # of one file; the fuzz suite runs beside others
UNNOTICED = 2**25  # bytes that Python takes whatever it reads

MADE = MADE | {name: changed_json(seeds(name)[0]) for name in ("baseline", "work", "running", "tracks_json")}
MADE |= {"journal": changed_json(seeds("journal")[0].splitlines()[0]).map(lambda line: line + b"\n")}


def profile(name: str) -> settings:
    few = FEW.get("apart" if READERS[name].apart else name, 25)
    return settings(
        max_examples=EXAMPLES * few // 25 if EXAMPLES else few,
        derandomize=not EXAMPLES,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate, Phase.shrink] if EXAMPLES else [Phase.generate],
    )


def survive(name: str, folder: Path, content: bytes) -> None:
    """Read a file, and hold the reader to its bounds."""
    reader = READERS[name]
    begun = time.process_time()
    tracemalloc.start()
    try:
        COUNTS[name, refused(reader, folder, content)] += 1
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 3 * min(LARGEST, max(SMALL, RATIO * len(content))) + UNNOTICED
    assert time.process_time() - begun < SECONDS


@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", READERS)
def test_damaged(name: str, tmp_path: Path) -> None:
    """Valid files, damaged byte by byte and piece by piece."""
    reader, valid = READERS[name], seeds(name)
    for content in valid:
        for wrap in reader.wraps:
            assert not refused(reader, tmp_path, wrap(content)) or name in ("npy", "override")

    @profile(name)
    @given(st.sampled_from(valid), st.sampled_from(reader.wraps), st.randoms(use_true_random=False))
    def tried(content: bytes, wrap: object, chance: random.Random) -> None:
        assert callable(wrap)
        survive(name, tmp_path, wrap(mutated(content, chance, valid)))

    tried()


@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", MADE)
def test_made(name: str, tmp_path: Path) -> None:
    """Files whose parts are each as they may be and do not fit each other."""

    @profile(name)
    @given(MADE[name])
    def tried(content: bytes) -> None:
        survive(name, tmp_path, content)

    tried()
