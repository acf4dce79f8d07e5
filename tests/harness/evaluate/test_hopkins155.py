"""Published numbers on a whole dataset, from the shell to the table."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.shell import Shell


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_ssc_reaches_its_published_error_on_hopkins155(nrsfm: Shell, tmp_path: Path, data_folder: Path) -> None:
    done = nrsfm("run", "experiment=hopkins155", timeout=1500, NRSFM_DATA=str(data_folder))
    assert (done.returncode, "620 trials: 620 run" in done.stdout) == (0, True), done.stderr[-2000:]
    done = nrsfm("report", "hopkins155", "--quiet", timeout=200, NRSFM_DATA=str(data_folder))
    assert done.returncode == 0, done.stderr
    table = json.loads((tmp_path / "out/report/hopkins155.json").read_text())
    found = {(c["dataset"], c["method"], c["metric"]): c["measured"] for c in table["cells"]}
    published = {"2": (1.52, 0.00), "3": (4.40, 0.56), "all": (2.18, 0.00)}
    for row, (mean, median) in published.items():
        assert found[row, "ssc_raw", "mean"] == pytest.approx(mean, abs=0.2)
        assert found[row, "ssc_raw", "median"] == pytest.approx(median, abs=0.2)
    assert {(c["method"], c["verdict"]) for c in table["cells"] if c["published"]} == {("ssc_raw", "reproduced")}
    measured = {"ssc_raw_4n": (1.85, 4.60, 2.47), "edsc_raw": (0.79, 1.79, 1.01), "lrr_raw": (1.69, 3.31, 2.06)}
    for method, means in measured.items():
        for row, mean in zip(published, means, strict=True):
            assert found[row, method, "mean"] == pytest.approx(mean, abs=0.1)
    assert len(table["parts"]["cells"]) == 620
