"""The answer: one sentence each on the paper's method, the baselines, this project's method and the claims."""

from __future__ import annotations

from typing import Any

from nrsfm.reports.report import Report
from tests.reports.conftest import full, make_answer

Answers = list[Any]


def test_counts_are_those_of_the_table(table2_answers: Answers) -> None:
    report = Report({"table2": table2_answers})
    ours, baselines, claims = report.answer
    assert ours.startswith("The paper's method as printed: ") and " of 16 published numbers" in ours
    assert baselines.startswith("The baselines: ") and " of 32 published numbers" in baselines
    counted = sum(int(sentence.split(": ")[1].split(" of ")[0]) for sentence in (ours, baselines))
    assert counted == report.tables[0].counts[1]
    assert claims.startswith("Of the paper's 10 claims 0 hold, 0 do not and 10 are not tested by these runs (nrsfm run")


def test_this_projects_method_stands_beside_the_printed_mean(table1_answers: Answers) -> None:
    own = [make_answer(trial.dataset["name"], "adaptive", 0) for trial, _ in full(("ours",), structure=False)]
    report = Report({"table1": [*table1_answers, *own]})
    (sentence,) = [sentence for sentence in report.answer if sentence.startswith("This project's method")]
    assert "Table 1: mean e_MS 0.0 (printed for the paper's 0.0)" in sentence
    verdicts = {cell.verdict for _, column, cell in report.tables[0].cells() if column.method == "adaptive"}
    assert verdicts == {"n/a"}


def test_a_study_claims_nothing() -> None:
    assert Report({"rank_study": [make_answer("dance_yoga", "bmm", None, e_3d=0.1)]}).answer[:-1] == ()
