"""The report of some experiments: tables, charts, claims and the page, and the files they are written to."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import write_text
from nrsfm.harness.record.tracked import Answer, Fetch, Tracked
from nrsfm.reports.answer import answer
from nrsfm.reports.claims import claims
from nrsfm.reports.claims.findings import Evidence, Judged
from nrsfm.reports.figures.chart import Chart
from nrsfm.reports.figures.charts import build_charts
from nrsfm.reports.formats.documents import FORMATS
from nrsfm.reports.page.report_page import page
from nrsfm.reports.tables.build import build
from nrsfm.reports.tables.model import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Report:
    """Tables, charts and claims of some experiments; each is built when it is first read."""

    answers: Mapping[str, Sequence[Answer]]  #: by experiment
    fetch: Fetch = field(default=lambda run: {})  #: by default no run has arrays
    evidence: Sequence[Tracked] = ()  #: the runs that the claims are judged by

    @cached_property
    def tables(self) -> list[Table]:
        """One table for each experiment, in the order of :attr:`answers`."""
        return [build(name, answers) for name, answers in self.answers.items()]

    @cached_property
    def charts(self) -> list[Chart]:
        """The charts that these experiments fill."""
        return build_charts(self.answers, self.fetch)

    @cached_property
    def judged(self) -> list[Judged]:
        """The paper's claims with their verdicts."""
        return claims.judge(Evidence(self.evidence, self.fetch))

    @cached_property
    def answer(self) -> tuple[str, ...]:
        """Whether the paper reproduces, in a few sentences."""
        return answer(self.tables, self.judged)

    @property
    def runs(self) -> dict[str, Tracked]:
        """Trial key -> the tracked run, for every trial that has one."""
        return {run.outcome.key: run for group in self.answers.values() for _, run in group if run}

    @property
    def summary(self) -> str:
        """One line for each table: how many published numbers were reproduced."""
        return "\n".join(table.summary for table in self.tables)

    def texts(self) -> dict[str, str]:
        """File name -> content: each table in every format, the claims, and the page.

        The paper's own LaTeX layout is left out for tables that no paper prints.
        """
        texts = {
            f"{table.name}{ending}": render(table)
            for table in self.tables
            for ending, render in FORMATS.items()
            if table.printed or ending != "_paper.tex"
        }
        judged = claims.data(self.judged)
        texts["claims.json"] = json.dumps(judged, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        texts["index.html"] = page(self.tables, self.charts, self.judged, self.answer, self.runs, self.fetch)
        return texts

    def write(self, folder: Path) -> list[Path]:
        """Write :meth:`texts` into a folder, which is made if it is missing; other files in it are kept.

        Everything is rendered before anything is written, and each file is written whole or not at all.

        Raises
        ------
        UsageError
            If the folder cannot be written to, or a table's name cannot be a file name.
        """
        texts = self.texts()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for name, text in texts.items():
                write_text(folder / name, text)
        except OSError as error:
            raise UsageError(f"cannot write the report to {folder}: {error.strerror}; choose another folder") from None
        return [folder / name for name in texts]

    def draw(self, folder: Path) -> list[Path]:
        """Write every chart, and a picture of each finished run with a structure, as svg, pdf and png."""
        from nrsfm.reports.figures.draw_run import save

        paths = []
        for name, figure in self._figures():
            for suffix in ("svg", "pdf", "png"):
                paths.append(folder / f"{name}.{suffix}")
                save(figure, paths[-1])
        return paths

    def _figures(self) -> Iterator[tuple[str, Figure]]:
        from nrsfm.reports.figures.draw_chart import chart_figure
        from nrsfm.reports.figures.draw_run import overview

        for chart in self.charts:
            yield chart.name, chart_figure(chart)
        drawn = set()
        for experiment, group in self.answers.items():
            for run in (run for _, run in group if run and "e_3d" in run.outcome.metrics):
                outcome, arrays = run.outcome, self.fetch(run)
                if outcome.key not in drawn and "tracks" in arrays:
                    drawn.add(outcome.key)
                    noise = f"_noise{outcome.level:g}_{outcome.repeat}" if outcome.level else ""
                    yield f"{experiment}_{outcome.dataset}_{outcome.method}{noise}", overview(arrays, outcome)
