"""From runs to tables and to a verdict, on the grid that CI runs: report, compare, bless."""

from __future__ import annotations

import csv
import json
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.shell import Shell


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The output folder of ``nrsfm run experiment=quick``, run once for all."""
    import os
    import subprocess
    import sys

    output = tmp_path_factory.mktemp("quick")
    done = subprocess.run(
        [sys.executable, "-m", "nrsfm", "run", "experiment=quick"],
        env={**os.environ, "NRSFM_OUTPUT": str(output)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return str(output)


def test_measured_agrees_with_the_committed_baseline(nrsfm: Shell, grid: str) -> None:
    done = nrsfm("compare", NRSFM_OUTPUT=grid)
    assert done.returncode == 0, done.stdout


def test_tampered_baseline_fails_and_names_the_row(nrsfm: Shell, grid: str, tmp_path: Path) -> None:
    true = json.loads(resources.files("nrsfm.reports.baselines").joinpath("quick.json").read_text())
    cells = [r for r in true["rows"] if r["method"] == "bmm_ssc3d" and r["level"] == 0]
    next(cell for cell in cells if cell["metric"] == "e_3d")["value"] *= 0.8
    path = tmp_path / "tampered.json"
    path.write_text(json.dumps(true))
    done = nrsfm("compare", f"compare.baseline={path}", NRSFM_OUTPUT=grid)
    assert done.returncode == 1, done.stdout
    (line,) = [line for line in done.stdout.splitlines() if " regressed: " in line]
    assert "person_face bmm_ssc3d" in line
    assert "e_3d regressed" in line
    for cell in cells:
        cell["method"] = "gone"
    path.write_text(json.dumps(true))
    assert nrsfm("compare", f"compare.baseline={path}", NRSFM_OUTPUT=grid).returncode == 2
    path.write_text("{")
    assert nrsfm("compare", f"compare.baseline={path}", NRSFM_OUTPUT=grid).returncode == 3


def test_every_format_says_the_same(nrsfm: Shell, grid: str, tmp_path: Path) -> None:
    names = {"markdown": "summary.md", "junit": "report.xml", "json": "gate.json"}
    options = [word for name, file in names.items() for word in (f"--{name}", str(tmp_path / file))]
    assert nrsfm("compare", *options, "--all", NRSFM_OUTPUT=grid).returncode == 0
    data = json.loads((tmp_path / "gate.json").read_text())
    (suite,) = ElementTree.parse(tmp_path / "report.xml").getroot()
    assert len(suite) == len(data["comparisons"][0]["lines"]) > 10
    assert not suite.findall(".//failure")
    assert (tmp_path / "summary.md").read_text().startswith("## Passed\n")


WORSE = '''
from nrsfm.methods.structure import bmm


class NoShrinking(bmm.BMM):
    """BMM whose nuclear-norm step leaves the singular values that it should shrink."""

    def reconstruct(self, observations, n_bodies=1):
        right = bmm.singular_value_threshold

        def wrong(M, threshold):
            shrunk, norm = right(M, threshold)
            return M, norm

        bmm.singular_value_threshold = wrong
        return super().reconstruct(observations, n_bodies)
'''


@pytest.mark.parametrize(
    "worse",
    [
        "method.reconstructor.algorithm=no_shrinking",
        pytest.param("method.reconstructor.tol=0.1", marks=pytest.mark.slow),
    ],
)
def test_a_worsened_method_is_caught(
    nrsfm: Shell, naughty_package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, worse: str
) -> None:
    """A step that does nothing, and a looser stop."""
    (naughty_package / "worse.py").write_text(WORSE)
    info = naughty_package / "worse-1.0.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: worse\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[nrsfm.methods]\nno_shrinking = worse:NoShrinking\n")
    monkeypatch.syspath_prepend(str(naughty_package))
    path = tmp_path / "mine.json"
    scene = ("method=bmm_ssc3d", "dataset.frames=60", "dataset.points=16")
    nrsfm("run", *scene)
    assert nrsfm("bless", str(path), *scene, "--reason", "as it is").returncode == 0
    assert nrsfm("compare", *scene, f"compare.baseline={path}").returncode == 0
    assert nrsfm("run", *scene, worse).returncode == 0
    done = nrsfm("compare", *scene, worse, f"compare.baseline={path}")
    assert done.returncode == 1, done.stdout
    assert "e_3d regressed" in done.stdout
    assert done.stdout.splitlines()[-1].startswith("Against the blessed baseline: ")


def test_nothing_measured_is_missing(nrsfm: Shell) -> None:
    done = nrsfm("compare")
    assert done.returncode == 2
    assert "not run yet" in done.stderr


def test_blessing_makes_the_measured_the_baseline(nrsfm: Shell, grid: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    assert nrsfm("bless", str(path), "experiment=quick", "--reason", "", NRSFM_OUTPUT=grid).returncode == 3
    done = nrsfm("bless", str(path), "--reason", "measured twice", "experiment=quick", NRSFM_OUTPUT=grid)
    assert (done.returncode, "10 rows" in done.stdout) == (0, True), done.stderr
    assert json.loads(path.read_text())["reason"] == "measured twice"
    assert nrsfm("compare", f"compare.baseline={path}", NRSFM_OUTPUT=grid).returncode == 0


def test_report_writes_every_format_of_one_table(nrsfm: Shell, grid: str, tmp_path: Path) -> None:
    folder = tmp_path / "report"
    done = nrsfm("report", "quick", "--folder", str(folder), "--figures", NRSFM_OUTPUT=grid)
    assert done.returncode == 0, done.stderr
    assert str(folder) in done.stdout
    assert {p.suffix for p in folder.glob("quick*")} == {".md", ".html", ".csv", ".json", ".tex"}
    rows = list(csv.DictReader((folder / "quick.csv").open()))
    measured = {r["method"]: r for r in rows if r["metric"] == "e_ms"}
    assert set(measured) == {"adaptive", "bmm_ssc3d", "ssc2d_bmm", "ssc2d", "edsc"}
    assert all(len(r["trial_key"]) == 16 for r in rows if r.get("trial_key") and ";" not in r["trial_key"])
    assert len(list((folder / "figures").glob("quick_person_face_*.png"))) == 6
    claims = json.loads((folder / "claims.json").read_text())
    assert [claim["number"] for claim in claims] == list(range(1, 11))
    before = {p.name: p.read_bytes() for p in folder.glob("*.*")}
    assert nrsfm("report", "quick", "--folder", str(folder), "--quiet", NRSFM_OUTPUT=grid).returncode == 0
    assert {p.name: p.read_bytes() for p in folder.glob("*.*")} == before


def test_report_of_nothing_says_so_and_still_writes(nrsfm: Shell, tmp_path: Path) -> None:
    done = nrsfm("report", "table1", "--quiet")
    assert done.returncode == 2
    assert "64 trials are not run yet" in done.stderr
    assert "not run" in (tmp_path / "out/report/table1.md").read_text()


def test_a_part_of_an_experiment_is_no_baseline(nrsfm: Shell, grid: str, tmp_path: Path) -> None:
    path = tmp_path / "part.json"
    done = nrsfm("bless", str(path), "--reason", "a part", "experiment=quick", "noise.level=0,0.5", NRSFM_OUTPUT=grid)
    assert done.returncode == 3
    assert "run the others first" in done.stderr
    assert not path.exists()
