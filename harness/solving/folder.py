"""The folder of a solution: the names of its files, and replacing it as a whole."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nrsfm.harness.record.errors import UsageError

MADE_BY = "nrsfm solve"  # in result.json: the mark of a solution's folder

RESULT, SUMMARY, ARRAYS, VIEW, CLOUDS = "result.json", "summary.txt", "reconstruction.npz", "view.html", "ply"
STRUCTURE, LABELS, CAMERAS, AFFINITY = "structure.csv", "labels.csv", "cameras.csv", "affinity.csv"
OUTLIERS = "outliers.csv"

#: Everything that a solution's folder may hold.
NAMES = frozenset({RESULT, SUMMARY, ARRAYS, VIEW, CLOUDS, STRUCTURE, LABELS, CAMERAS, AFFINITY, OUTLIERS})


def check_folder(folder: Path) -> None:
    """Raise UsageError unless a folder can be made, is empty, or holds a solution and nothing else."""
    if not folder.exists():
        place = next(parent for parent in folder.absolute().parents if parent.exists())
        try:
            tempfile.TemporaryDirectory(dir=place).cleanup()
        except OSError as error:
            raise UsageError(f"cannot make a folder in {place} ({error.strerror}); choose another with --out") from None
        return
    names = {path.name for path in folder.iterdir()} if folder.is_dir() else {folder.name}
    if not folder.is_dir() or (names and not _is_solution(folder)):
        raise UsageError(f"{folder} exists and is no solution of {MADE_BY}; choose another folder with --out")
    if foreign := sorted(names - NAMES):
        raise UsageError(
            f"{folder} holds {foreign[0]!a}, which would be lost; move it, or choose another folder with --out"
        )


@contextmanager
def replaced(folder: Path) -> Iterator[Path]:
    """A temporary folder that takes the place of ``folder`` when the block ends, or vanishes if the block fails."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    _remove_leftovers(folder)
    new = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}.{os.getpid()}."))
    before = new.with_name(f"{new.name}.before")
    try:
        yield new
        new.chmod(0o755)
        if folder.is_dir():
            folder.rename(before)
        try:
            new.rename(folder)
        except BaseException:
            if before.is_dir():
                before.rename(folder)
            raise
    finally:
        shutil.rmtree(new, ignore_errors=True)
        shutil.rmtree(before, ignore_errors=True)


def _is_solution(folder: Path) -> bool:
    try:
        record = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(record, dict) and record.get("made_by") == MADE_BY


def _remove_leftovers(folder: Path) -> None:
    """Remove the temporary folders of processes that were killed while they wrote to ``folder``."""
    for left in folder.parent.glob(f".{folder.name}.*.*"):
        pid = left.name.removeprefix(f".{folder.name}.").partition(".")[0]
        if pid.isdigit() and left.is_dir():
            try:
                os.kill(int(pid), 0)
            except ProcessLookupError:
                if left.name.endswith(".before") and not folder.exists():
                    left.rename(folder)  # killed between the two renames
                else:
                    shutil.rmtree(left, ignore_errors=True)
            except (PermissionError, OverflowError):
                continue
