"""The LaTeX compiles, in the layout of the paper and in that of the audit, whatever text stands in it."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from nrsfm.reports.formats import documents as writers
from nrsfm.reports.tables.build import build
from nrsfm.reports.tables.model import Table
from tests.reports.conftest import Answers
from tests.reports.formats.test_documents import hostile, mixed

__all__ = ["hostile", "mixed"]

pytestmark = pytest.mark.tex

DOCUMENT = r"""\documentclass{article}
\usepackage[margin=2cm,landscape]{geometry}
\usepackage{booktabs,longtable,multirow}
\begin{document}
\input{table.tex}
\end{document}
"""


def compiled(tex: str, folder: Path) -> str:
    """The engine's log; fails on any error."""
    (folder / "table.tex").write_text(tex)
    (folder / "main.tex").write_text(DOCUMENT)
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "-no-shell-escape", "main.tex"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace", check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    assert (folder / "main.pdf").stat().st_size > 5000
    return done.stdout


@pytest.mark.parametrize("writer", [writers.tex_paper, writers.tex_audit])
class TestEngine:
    def test_the_papers_tables_fit_their_page(
        self, writer: Callable[[Table], str], tmp_path: Path, table1_answers: Answers, table2_answers: Answers
    ) -> None:
        for name, answers in (("table1", table1_answers), ("table2", table2_answers)):
            assert "Overfull" not in compiled(writer(build(name, answers)), tmp_path)

    def test_hostile_text_and_mixed_rows(
        self, writer: Callable[[Table], str], tmp_path: Path, hostile: Table, mixed: Table
    ) -> None:
        for table in (hostile, mixed):
            compiled(writer(table), tmp_path)
