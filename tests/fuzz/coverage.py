"""Coverage-guided fuzzing of every reader, a process each: ``python -m tests.fuzz.coverage [READER ...]``.

Prints how many inputs each reader took. Inputs that a reader did not survive are kept in the folder ``--keep``, and
the exit code is then 1. Needs atheris (the extra ``fuzz``).
"""

from __future__ import annotations

import argparse
import os
import random
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MEMORY_MB = 2048
ONE_INPUT_SECONDS = 20


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.coverage", description=__doc__.partition("\n")[0])
    parser.add_argument("readers", nargs="*", help="all that read in their own process, by default")
    parser.add_argument("--seconds", type=int, default=int(os.environ.get("FUZZ_SECONDS", "60")), help="for each")
    parser.add_argument(
        "--keep", type=Path, default=Path("fuzz-findings"), help="folder for inputs that a reader did not survive"
    )
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        _fuzz(arguments.readers[0], arguments.seconds, arguments.keep)
    from tests.fuzz.readers import READERS

    total = 0
    for name in arguments.readers or [name for name, reader in READERS.items() if not reader.apart]:
        if READERS[name].apart:
            parser.error(f"{name} reads in a process of its own, which coverage does not reach")
        arguments.keep.mkdir(parents=True, exist_ok=True)
        begun = time.monotonic()
        command = [sys.executable, "-m", "tests.fuzz.coverage", "--one", name]
        command += ["--seconds", str(arguments.seconds), "--keep", str(arguments.keep)]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
        count = re.search(r"number_of_executed_units: (\d+)", done.stderr)
        edges = re.findall(r"cov: (\d+)", done.stderr)
        tried = int(count[1]) if count else 0
        total += tried
        verdict = "ok" if done.returncode == 0 and count else f"FAILED with exit code {done.returncode}"
        words = f"{tried} inputs in {time.monotonic() - begun:.0f} s, {edges[-1] if edges else '?'} branches"
        print(f"{name:<16} {words}: {verdict}", flush=True)
        if done.returncode or not count:
            print(done.stderr[-3000:], file=sys.stderr)
            return 1
    print(f"{'all':<16} {total} inputs")
    return 0


def _fuzz(name: str, seconds: int, keep: Path) -> None:
    """Fuzz one reader; does not return."""
    import atheris

    with atheris.instrument_imports(include=["nrsfm", "zipfile"]):
        from tests.fuzz.mutation import mutated
        from tests.fuzz.readers import READERS, refused, seeds

    reader, valid = READERS[name], seeds(name)
    shm = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(dir=shm if shm.is_dir() else None))
    corpus = folder / "corpus"
    corpus.mkdir()
    for k, content in enumerate(valid):
        (corpus / str(k)).write_bytes(bytes([k]) + content)

    def one(data: bytes) -> None:
        wrap = reader.wraps[(data[0] if data else 0) % len(reader.wraps)]
        refused(reader, folder, wrap(data[1:]))

    def mutator(data: bytes, most: int, seed: int) -> bytes:
        chance = random.Random(seed)
        if chance.random() < 0.5:
            return bytes(atheris.Mutate(data, most))
        return (data[:1] + mutated(data[1:], chance, valid))[:most]

    limits = [f"-max_total_time={seconds}", f"-timeout={ONE_INPUT_SECONDS}", f"-rss_limit_mb={MEMORY_MB}"]
    output = [f"-artifact_prefix={keep}/{name}-", "-print_final_stats=1", "-verbosity=1"]
    most = f"-max_len={2 * max(map(len, valid)) + 4096}"
    atheris.Setup([sys.argv[0], *limits, *output, most, str(corpus)], one, custom_mutator=mutator)
    atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())
