"""Every format is written from the one model, says the same, and lets no foreign text through."""

from __future__ import annotations

import csv
import io
import itertools
import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from nrsfm.harness.evaluate.metric_type import needed
from nrsfm.harness.record.trial import Trial
from nrsfm.reports.claims.claims import judge
from nrsfm.reports.claims.findings import Evidence
from nrsfm.reports.formats import documents as writers
from nrsfm.reports.formats.console import console
from nrsfm.reports.formats.records import csv_text, json_text, records
from nrsfm.reports.page.report_page import page
from nrsfm.reports.page.standalone import plotly
from nrsfm.reports.report import Report
from nrsfm.reports.tables.build import build
from nrsfm.reports.tables.model import Table
from tests.reports.conftest import Answers, MakeAnswer

HOSTILE = (
    "<script>alert(1)</script> \\input{/etc/passwd} a|b & 100% $x_1^2$ #1 ~ `*x*` [y](javascript:z)\nnext & \x1b[2J"
)
VOID = {"meta", "br", "input"}
PROGRAMS = 3  # in the page: its data, the library and its own


@pytest.fixture
def hostile(answer: MakeAnswer) -> Table:
    """A table whose dataset, method, error and parameters are all out to break it."""
    answers = [
        answer(HOSTILE, HOSTILE, status="failed", error=HOSTILE, run_id=HOSTILE, parameters={HOSTILE: HOSTILE}),
        answer("dance_yoga", "ours", status="failed", error=HOSTILE),
        answer("dance_yoga", "ssc2d", 3, uri='https://x/"><script>alert(2)</script>'),
    ]
    return build("table1", answers)


@pytest.fixture
def mixed(answer: MakeAnswer, trial: Callable[..., Trial]) -> Table:
    """Repeats, stand-ins, failures, empty cells and numbers in one table."""
    answers: Answers = [
        answer("dance_yoga", "ours", n, level=0.02, repeat=r, e_3d_dai=0.04) for r, n in enumerate((1, 2))
    ]
    answers += [
        answer("face_yoga", "ours", 1, e_3d_dai=0.03, e_3d=0.02, stand_in=True),
        (trial("face_yoga", "edsc"), None),
    ]
    answers += [
        answer("shark_yoga", m, n, e_3d_dai=0.036) for m, n in (("ours", 1), ("bmm_ssc3d", 54), ("ssc2d_bmm", 2))
    ]
    answers += [answer("stretch_yoga", m, 2, e_3d_dai=0.1 / 3) for m in ("ours", "bmm_ssc3d")]
    return build("table2", answers)


class Tags(HTMLParser):
    """Collects elements and their attributes, and checks that they nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)
        self.close()
        assert not self.open, f"left open: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def tabulars(tex: str) -> list[tuple[int, list[int]]]:
    """For every tabular or longtable: columns of its head, and of every row."""
    found = []
    for env in re.finditer(r"\\begin\{(tabular|longtable)\}\{([lcr]+)\}(.*?)\\end\{\1\}", tex, re.DOTALL):
        body = re.sub(r"\\caption.*?\\\\", "", env[3], flags=re.DOTALL)
        widths = []
        for line in body.split(r"\\"):
            line = re.sub(
                r"\\(toprule|midrule|bottomrule|endhead|addlinespace|cmidrule\(lr\)\{[\d-]+\})", "", line
            ).strip()
            if line:
                spans = sum(int(n) - 1 for n in re.findall(r"\\multicolumn\{(\d+)\}", line))
                widths.append(len(re.findall(r"(?<!\\)&", line)) + 1 + spans)
        found.append((len(env[2]), widths))
    return found


class TestData:
    def test_json_holds_the_whole_table(
        self, table1_answers: Answers, table2_answers: Answers, mixed: Table, hostile: Table
    ) -> None:
        for table in (build("table1", table1_answers), build("table2", table2_answers), mixed, hostile):
            data = json.loads(json_text(table))
            assert data["cells"] == list(records(table))
            assert [row["label"] for row in data["rows"]] == [row.label for row in table.rows]
            assert [(note["text"], note["loud"]) for note in data["notes"]] == [(n.text, n.loud) for n in table.notes]
            assert [(c["method"], c["metric"]["name"], c["metric"]["logged"]) for c in data["columns"]] == [
                (column.method, column.metric.name, column.metric.logged) for column in table.columns
            ]
            means = [[cell["measured"] for cell in row["cells"]] for row in data["means"]]
            assert means == [[cell.measured for cell in row.cells] for row in table.means]

    def test_csv(self, mixed: Table, hostile: Table) -> None:
        for table in (mixed, hostile):
            rows = list(csv.DictReader(io.StringIO(csv_text(table))))
            want = list(records(table))
            assert len(rows) == len(want) == len(table.rows) * len(table.columns)
            for row, record in zip(rows, want, strict=True):
                for name, value in record.items():
                    if isinstance(value, bool):
                        assert row[name] == str(value).lower()
                    elif isinstance(value, float):
                        assert float(row[name]) == value
                    elif isinstance(value, list):
                        assert row[name] == " ".join(value)
                    else:
                        assert row[name] == ("" if value is None else str(value))

    def test_one_line_a_cell_with_its_trial_and_run(self, table1_answers: Answers) -> None:
        rows = list(csv.DictReader(io.StringIO(csv_text(build("table1", table1_answers)))))
        assert len({(row["dataset"], row["method"], row["metric"]) for row in rows}) == len(rows) == 32
        (row,) = [r for r in rows if (r["dataset"], r["method"]) == ("dance_yoga", "ssc2d")]
        assert (row["published"], row["wrong_tracks"], row["tracks"]) == ("0.025", "7.0", "116")
        assert (row["verdict"], row["difference"], row["difference_unit"]) == ("worse", "4.0", "tracks")
        run = needed(table1_answers[0][1])
        assert (row["trial_key"], row["run_id"]) == (run.outcome.key, run.run_id)


@pytest.mark.parametrize("ending", list(writers.FORMATS))
class TestEveryFormat:
    def test_the_same_bytes_again(self, ending: str, table2_answers: Answers) -> None:
        texts = [writers.FORMATS[ending](build("table2", table2_answers)) for _ in range(2)]
        assert texts[0] == texts[1]

    def test_stand_ins_are_labelled_in_name_and_notes(self, ending: str, mixed: Table) -> None:
        text = writers.FORMATS[ending](mixed)
        assert "Face + Yoga" in text
        assert "(stand-in)" in text
        if ending != ".csv":
            assert "procedural stand-in: the real sequence was not found" in text
        else:
            assert ",true," in text

    @pytest.mark.parametrize(("name", "loud"), [("processor", True), ("code", False)])
    def test_mixed_environments_are_told(self, ending: str, name: str, loud: bool, answer: MakeAnswer) -> None:
        """By every writer; numbers alone go into the CSV, and the paper's table says what changes its numbers."""
        runs = [answer(d, "ours", 0, environment={name: d[:5]}) for d in ("dance_yoga", "face_yoga")]
        told = "not all runs are of one environment" in writers.FORMATS[ending](build("table1", runs)).lower()
        assert told == (ending != ".csv" and (loud or ending != "_paper.tex"))

    def test_measured_numbers_are_there(self, ending: str, mixed: Table) -> None:
        assert "0.0360" in writers.FORMATS[ending](mixed) or "0.036" in writers.FORMATS[ending](mixed)

    def test_reasons_stand_in_empty_cells(self, ending: str, mixed: Table) -> None:
        if ending != "_paper.tex":
            assert "not run" in writers.FORMATS[ending](mixed)


class TestHtml:
    def test_hostile_text_makes_no_element(self, hostile: Table) -> None:
        judged = judge(Evidence([], lambda _: {}))
        whole = page([hostile], [], judged, [], {}, lambda _: {}).replace(plotly(), "")
        for text in (writers.html(hostile), whole):
            seen = Tags(text).seen
            assert [tag for tag, _ in seen].count("script") == (PROGRAMS if text is whole else 0)
            assert not [name for _, attributes in seen for name in attributes if name.startswith("on")]
            assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text
            assert "\x1b" not in text

    def test_links_lead_to_runs(self, table1_answers: Answers, answer: MakeAnswer) -> None:
        table = build("table1", [answer("dance_yoga", "ours", 0, uri="http://mlflow:5000", run_id="r1")])
        links = {attributes.get("href") for tag, attributes in Tags(writers.html(table)).seen if tag == "a"}
        assert links == {"http://mlflow:5000/#/runs/r1"}
        assert "a" not in {tag for tag, _ in Tags(writers.html(build("table1", table1_answers))).seen}

    def test_every_row_has_every_column(self, mixed: Table) -> None:
        text = writers.html(mixed)
        grid = text[text.index('class="grid"') : text.index("</table>")]
        rows = re.findall(r"<tr.*?</tr>", grid[grid.index("<tbody>") :], re.DOTALL)
        assert len(rows) == len(mixed.rows) + len(mixed.means)
        assert {row.count("<td") for row in rows} == {len(mixed.columns)}

    def test_verdicts_have_symbol_words_and_tone(self, table1_answers: Answers) -> None:
        text = writers.html(build("table1", table1_answers))
        cell = text[text.index("0.0603") - 250 : text.index("0.0603") + 200]
        assert 'class="cell bad first"' in cell
        assert "not reproduced (worse)" in cell
        assert "↑ +4" in cell

    def test_nothing_is_loaded_from_elsewhere(self, mixed: Table) -> None:
        text = writers.html(mixed)
        assert "http" not in text
        assert "@import" not in text
        assert "url(" not in text


class TestLatex:
    @pytest.mark.parametrize("writer", [writers.tex_paper, writers.tex_audit])
    def test_braces_balance_and_rows_are_as_wide_as_their_table(
        self, writer: Callable[[Table], str], hostile: Table, mixed: Table, table1_answers: Answers
    ) -> None:
        for table in (hostile, mixed, build("table1", table1_answers), build("empty", [])):
            tex = writer(table)
            bare = re.sub(r"\\[{}]", "", re.sub(r"(?m)^%.*$", "", tex))
            assert bare.count("{") == bare.count("}")
            assert tabulars(tex) or not table.columns
            for width, rows in tabulars(tex):
                assert set(rows) <= {width}

    @pytest.mark.parametrize("writer", [writers.tex_paper, writers.tex_audit])
    def test_hostile_text_stays_text(self, writer: Callable[[Table], str], hostile: Table) -> None:
        tex = writer(hostile)
        assert "\\input" not in tex
        assert "\x1b" not in tex
        assert tex.isascii()
        assert not re.search(r"(?<!\\)\$x", tex)
        assert not re.search(r"(?<!\\)#", tex)
        assert all(line.startswith("% ") for line in tex.splitlines() if re.search(r"(?<!\\)%", line))

    def test_hostile_text_is_still_readable(self, hostile: Table) -> None:
        tex = writers.tex_audit(hostile)
        assert r"\textless{}script\textgreater{}alert(1)" in tex
        assert r"\textbackslash{}input\{/etc" in tex

    def test_the_papers_table(self, table2_answers: Answers) -> None:
        tex = writers.tex_paper(build("table2", table2_answers))
        assert (
            r"\multicolumn{2}{c}{BMM + SSC (3D)} & \multicolumn{2}{c}{SSC(2D) + BMM} & \multicolumn{2}{c}{Our Method}"
            in tex
        )
        assert (
            r"Dance + Yoga & \textbf{0.0318} & 0.1466 & \textbf{0.0318} & 0.0603 & 0.0324 & \textbf{0.0259} \\" in tex
        )
        assert "0.0456" not in tex, "a published number in the measured table"
        body = tex[tex.index("midrule") :]
        names = re.findall(r"^    (\w+ \+ \w+) &", body, re.MULTILINE)
        assert names[0] == "Dance + Yoga"
        assert names[-1] == "Stretch + Yoga"
        assert len(names) == 8

    def test_the_papers_columns_alone(self, table1_answers: Answers) -> None:
        tex = writers.tex_paper(build("table1", table1_answers))
        assert r"Dataset & SSC ($e_{MS}$) & EDSC ($e_{MS}$) & Ours \\" in tex
        assert "share" not in tex
        assert r"Drink+Walking & \textbf{0.0} & 0.3646 & \textbf{0.0} \\" in tex

    def test_the_audit_has_published_wrong_and_verdict(self, table1_answers: Answers) -> None:
        tex = writers.tex_audit(build("table1", table1_answers))
        assert r"Dance+Yoga & SSC(2D) & 0.025 & 0.0603 & 7/116 & +4 & not reproduced (worse) \\" in tex
        assert r"& SSC(2D), share .7 & -- & \textbf{0.0} & 0/116 & -- & n/a: no published number \\" in tex


class TestMarkdown:
    def test_rows_are_as_wide_as_their_table(self, hostile: Table, mixed: Table) -> None:
        for table in (hostile, mixed):
            blocks = re.findall(r"(?:^\|.*\|\n)+", writers.markdown(table), re.MULTILINE)
            assert len(blocks) == 1 + (table.literature is not None) + len(table.metrics)
            for block in blocks:
                widths = {len(re.findall(r"(?<!\\)\|", line)) for line in block.splitlines()}
                assert len(widths) == 1
            assert len(blocks[0].splitlines()) == 2 + len(table.rows) + len(table.means)

    def test_hostile_text_stays_text(self, hostile: Table) -> None:
        text = writers.markdown(hostile)
        assert "<script" not in text
        assert "a\\|b" in text
        assert "\\[y\\](javascript:z) next" in text
        assert "\x1b" not in text

    def test_published_stands_beside_measured(self, table1_answers: Answers) -> None:
        text = writers.markdown(build("table1", table1_answers))
        assert (
            "| Dance+Yoga | 0.0603 (0.025) ↑ 7/116 | **0.0** 0/116 | 0.1034 (0.0345) ↑ 12/116 | 0.0259 (0.0) ↑ 3/116 |"
            in text
        )


class TestConsole:
    def text(self, table: Table, **options: Any) -> str:
        out = io.StringIO()
        console(table, Console(file=out, **options))
        return out.getvalue()

    def test_plain_when_it_is_no_terminal(self, mixed: Table, table2_answers: Answers, hostile: Table) -> None:
        for table in (mixed, build("table2", table2_answers), hostile):
            text = self.text(table)
            assert "\x1b" not in text
            assert max(len(line) for line in text.splitlines()) <= 120
            assert table.title in text

    def test_mixed_machines_are_told_above_the_table(self, answer: MakeAnswer) -> None:
        runs = [answer(d, "ours", 0, environment={"processor": d}) for d in ("dance_yoga", "face_yoga")]
        text = " ".join(self.text(build("table1", runs)).split())
        assert "! Not all runs are of one environment: processor = dance_yoga (1) | face_yoga (1)." in text

    def test_colour_in_a_terminal(self, table2_answers: Answers) -> None:
        assert "\x1b[" in self.text(
            build("table2", table2_answers), force_terminal=True, width=120, color_system="standard"
        )

    def test_published_measured_wrong_and_verdict_on_one_line(self, table1_answers: Answers) -> None:
        line = next(line for line in self.text(build("table1", table1_answers)).splitlines() if "SSC(2D) " in line)
        assert line.split() == ["Dance+Yoga", "SSC(2D)", "0.025", "0.0603", "↑", "7/116"]

    def test_reasons_are_told_in_full_below(self, answer: MakeAnswer) -> None:
        text = self.text(build("table1", [answer("dance_yoga", "ours", status="failed", error="SVD did not converge")]))
        assert "Ours e_MS: failed: SVD did not converge (Dance+Yoga)" in text


class TestReport:
    def test_every_format_of_every_table_in_one_folder(
        self, tmp_path: Path, table1_answers: Answers, table2_answers: Answers
    ) -> None:
        answers = {"table1": table1_answers, "table2": table2_answers}
        report = Report(answers)
        files = report.write(tmp_path / "a" / "report")
        assert sorted(p.name for p in files) == sorted(p.name for p in (tmp_path / "a" / "report").iterdir())
        formats = {f"table{n}{end}" for n in (1, 2) for end in writers.FORMATS}
        assert {p.name for p in files} == formats | {"index.html", "claims.json"}
        built = {table.name: table for table in report.tables}
        for name, ending in itertools.product(answers, writers.FORMATS):
            text = (tmp_path / "a" / "report" / f"{name}{ending}").read_bytes()
            assert text == writers.FORMATS[ending](built[name]).encode()
        before = {p: p.read_bytes() for p in files}
        assert {p: p.read_bytes() for p in Report(answers).write(tmp_path / "a" / "report")} == before
        assert report.summary.splitlines()[1].startswith("Table 2: ")

    def test_a_table_that_no_paper_prints_has_no_paper_layout(self, tmp_path: Path, answer: MakeAnswer) -> None:
        answers: dict[str, Answers] = {"quick": [answer("person_face", "ours", 1)]}
        assert "quick_paper.tex" not in {path.name for path in Report(answers).write(tmp_path)}
        out = io.StringIO()
        for table in Report(answers).tables:
            console(table, Console(file=out))
        assert "paper" not in out.getvalue()

    def test_nothing_is_written_if_one_table_cannot_be(self, tmp_path: Path, table1_answers: Answers) -> None:
        with pytest.raises(ValueError, match="table name"):
            Report({"table1": table1_answers, "../x": []}).write(tmp_path / "report")
        assert not (tmp_path / "report").exists()

    def test_a_folder_that_is_a_file(self, tmp_path: Path) -> None:
        (tmp_path / "report").write_text("")
        with pytest.raises(ValueError, match="cannot write the report"):
            Report({"table1": []}).write(tmp_path / "report")

    def test_json_is_strict(self, tmp_path: Path, mixed: Table) -> None:
        json.loads(json_text(mixed), parse_constant=lambda name: pytest.fail(name))
