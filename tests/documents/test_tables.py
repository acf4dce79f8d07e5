"""The tables of the README and of the page of tables are what the code prints."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from nrsfm.harness.cli.compare import locate
from nrsfm.harness.config.spans import expand
from nrsfm.harness.gate.baseline import Baseline, Blessed
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.tracked import Tracked
from nrsfm.harness.record.trial import Trial
from nrsfm.reports.answer import answer
from nrsfm.reports.formats.embed import update_document
from nrsfm.reports.tables.build import build
from nrsfm.reports.tables.model import Table
from tests.shell import ROOT, Shell

README, TABLES = "README.md", "docs/tables.md"


def blessed_run(trial: Trial, row: Blessed) -> Tracked:
    """A run that measured the blessed numbers."""
    metrics = dict(row.metrics)
    if row.n_points and "n_wrong" in metrics:
        metrics["e_ms"] = metrics["n_wrong"] / row.n_points
    outcome = Outcome(
        key=row.trials[0],
        setting=trial.setting,
        status=row.status,
        dataset=row.dataset,
        method=row.method,
        cameras=row.cameras,
        placement=row.placement,
        motion=row.motion,
        level=row.level,
        repeat=0,
        n_points=row.n_points,
        metrics=metrics,
    )
    return Tracked(outcome, run_id="8f3c", uri="")


def blessed_table(name: str) -> Table:
    """The table of an experiment, filled with the blessed numbers."""
    rows = {(row.dataset, row.method): row for row in Baseline.read(locate("tables")).rows}
    trials = [trial for trial, _ in expand([f"experiment={name}"])]
    return build(name, [(t, blessed_run(t, rows[t.dataset["name"], t.method["name"]])) for t in trials])


@pytest.mark.parametrize(("page", "name"), [(README, "table2"), (TABLES, "table1"), (TABLES, "table2")])
def test_tables_are_printed_from_the_blessed_numbers(page: str, name: str, tmp_path: Path) -> None:
    """Whoever changes a number blesses it, and whoever blesses it renews the documents."""
    copy = tmp_path / "page.md"
    shutil.copy(ROOT / page, copy)
    update_document(copy, [blessed_table(name)])
    assert copy.read_text() == (ROOT / page).read_text(), f"nrsfm report {name} --into {page}"


def test_the_answer_follows_from_the_blessed_numbers() -> None:
    sentences = answer([blessed_table("table1"), blessed_table("table2")], [])
    assert len(sentences) == 3
    text = (ROOT / README).read_text()
    for sentence in sentences:
        assert f"\n- {sentence}\n" in text


@pytest.mark.slow
@pytest.mark.timeout(14400)
@pytest.mark.data
def test_tables_are_what_is_measured(shell: Shell, data_folder: Path, tmp_path: Path) -> None:
    real = {"NRSFM_DATA": str(data_folder)}
    assert shell("run", "experiment=tables", timeout=7200, **real).returncode == 0
    done = shell("compare", "experiment=tables", "compare.baseline=tables", timeout=3600, **real)
    assert done.returncode == 0, done.stdout
    for page in (README, TABLES):
        copy = tmp_path / "page.md"
        shutil.copy(ROOT / page, copy)
        assert shell("report", "--quiet", "--into", str(copy), timeout=3600, **real).returncode == 0
        assert copy.read_text() == (ROOT / page).read_text()
    size = (tmp_path / "out/report/index.html").stat().st_size
    assert size < 15 * 2**20
