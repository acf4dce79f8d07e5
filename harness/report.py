"""Writes the tables of experiments into one folder. Never runs a method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from harness.record import UsageError
from harness.worker import write_atomically
from reports.tables import Answer, Table, build
from reports.writers import FORMATS


def tables(answers_by_table: Mapping[str, Sequence[Answer]]) -> list[Table]:
    """One table for each experiment, in the order given.

    Parameters
    ----------
    answers_by_table : mapping
        Experiment -> what was asked and the run that answers it, None where none does.
    """
    return [build(name, answers) for name, answers in answers_by_table.items()]


def summary(built: Sequence[Table]) -> str:
    """One line a table: how many published numbers were reproduced."""
    return "\n".join(table.summary for table in built)


def write(answers_by_table: Mapping[str, Sequence[Answer]], folder: Path) -> list[Path]:
    """Write every format of every table.

    Everything is rendered before anything is written, and each file appears whole or not at all.

    Parameters
    ----------
    answers_by_table : mapping
        As for :func:`tables`.
    folder : Path
        Made if it is missing. Files of other names in it are left alone.

    Returns
    -------
    list of Path
        The files, table by table.

    Raises
    ------
    UsageError
        If the folder cannot be written to, or a table's name cannot be a file's.
    """
    texts = {
        f"{table.name}{ending}": writer(table)
        for table in tables(answers_by_table)
        for ending, writer in FORMATS.items()
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            write_atomically(folder / name, lambda handle, text=text: handle.write(text.encode()))
    except OSError as error:
        raise UsageError(f"cannot write the report to {folder}: {error.strerror}; choose another folder") from None
    return [folder / name for name in texts]
