"""The page in a real browser, headless: it opens, sorts, opens runs, plays, and shows foreign text as text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nrsfm.harness.evaluate.metric_type import needed
from nrsfm.reports.report import Report
from tests.reports.conftest import Shown, full, make_answer

pytestmark = pytest.mark.browser

EVIL = "<img src=x onerror=document.title='broken'></script><script>document.title='broken'</script>"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of both tables, its structures random walks, one run failed with an error out to break it."""
    rng = np.random.default_rng(0)
    truth = np.cumsum(rng.standard_normal((40, 3, 20)), axis=0)
    labels = np.repeat([0, 1], 10)
    arrays = {
        "structure": truth + 0.1,
        "true_structure": truth,
        "labels": np.where(np.arange(20) == 3, 1, labels),
        "true_labels": labels,
        "affinity": rng.random((20, 20)),
        "frame_e_3d": rng.random(40),
        "history_objective": np.arange(50.0),
        "history_shape": np.exp(-np.arange(50.0)),
    }
    table1 = [
        *full(("ssc2d", "edsc"), structure=False),
        make_answer("dance_yoga", "ours", status="failed", error=EVIL, parameters={"seed": 1}),
    ]
    table2 = full(("bmm_ssc3d", "ssc2d_bmm", "ours"), structure=True)
    table2[0] = (table2[0][0], replace(needed(table2[0][1]), run_id=EVIL))
    folder = tmp_path_factory.mktemp("page")
    Report({"table1": table1, "table2": table2}, lambda _: arrays).write(folder)
    return folder / "index.html"


@pytest.fixture
def shown(browser: Any, report: Path) -> Iterator[Shown]:
    page = Shown(browser, report, viewport={"width": 1200, "height": 800})
    yield page
    page.page.context.close()


def test_a_cell_opens_its_run_and_the_player_plays(shown: Shown) -> None:
    page = shown.page
    button = page.locator("#table2 .grid button.open").first
    button.focus()
    page.keyboard.press("Enter")  # no mouse needed
    page.wait_for_selector("dialog[open]")
    assert "dance_yoga, bmm_ssc3d" in page.inner_text("dialog h2")
    assert "e_3D (e_3d_dai)" in page.inner_text("dialog .metrics")
    assert "trial" in page.inner_text("dialog .facts")
    place, verdict = page.locator("dialog p.cell").all_inner_texts()
    assert place.startswith("Dance + Yoga, BMM + SSC(3D), e_3D: ")
    assert verdict.startswith("published 0.0456: ")
    first, before = shown.frame(), shown.scene()
    page.keyboard.press(" ")  # the play button has the focus
    shown.until(lambda: shown.frame() > first + 2)
    assert shown.scene() != before
    page.keyboard.press(" ")
    page.wait_for_timeout(300)
    held = shown.frame()
    page.wait_for_timeout(400)
    assert shown.frame() == held
    assert not page.locator("dialog .modebar").count()
    page.keyboard.press("ArrowRight")
    shown.until(lambda: shown.frame() == min(held + 1, 39))
    names = page.evaluate("document.querySelector('dialog .view').data.map(t => t.name)")
    assert names[0] == "ground truth"
    assert "wrong label (1)" in names
    assert page.locator("dialog .js-plotly-plot").count() == 5  # the view, e_3D, residuals, objective, affinity
    page.keyboard.press("Escape")
    page.wait_for_selector("dialog[open]", state="detached")
    assert button.evaluate("b => b === document.activeElement")
    assert shown.troubles == []


def test_nothing_is_asked_of_any_network(shown: Shown, report: Path) -> None:
    shown.page.locator("#figures").scroll_into_view_if_needed()
    shown.page.wait_for_selector("#figures .js-plotly-plot")
    assert {url for url in shown.asked if not url.startswith(("data:", "blob:"))} == {report.as_uri()}
    assert shown.troubles == []


def test_foreign_text_is_text(shown: Shown) -> None:
    page = shown.page
    page.locator("#table1 .grid button.open", has_text="failed").first.click()
    page.wait_for_selector("dialog[open]")
    assert page.inner_text("dialog .error") == EVIL
    page.keyboard.press("Escape")
    page.locator("#table2 .grid button.open").first.click()
    assert EVIL in page.inner_text("dialog .facts")
    assert page.locator("img").count() == 0
    assert "broken" not in page.title()
    assert shown.troubles == []


def test_columns_sort_both_ways_with_means_and_empty_cells_last(shown: Shown) -> None:
    page = shown.page
    column = "[...document.querySelectorAll('#table1 .grid tbody tr:not(.mean)')].map(r => r.cells[1].dataset.value)"
    button = page.locator("#table1 .grid button.sort[data-column='1']")
    button.click()
    up = [float(value) for value in page.evaluate(column)]
    assert up == sorted(up)
    assert page.locator("#table1 th[aria-sort=ascending]").count() == 1
    button.click()
    assert [float(value) for value in page.evaluate(column)] == sorted(up, reverse=True)
    assert page.evaluate("document.querySelector('#table1 .grid tbody tr:last-child').className") == "mean"
    page.locator("#table1 .grid button.sort[data-column='3']").click()  # ours: one failed, the others not run
    assert shown.troubles == []


def test_plotly_is_read_when_it_is_needed(shown: Shown) -> None:
    assert shown.page.evaluate("typeof Plotly") == "undefined"
    shown.page.locator("#table2 .grid button.open").first.click()
    shown.frame()
    assert shown.page.evaluate("typeof Plotly") == "object"


def test_columns_are_ticked(browser: Any, tmp_path: Path) -> None:
    table1 = full(("ssc2d", "ssc2d_share70", "edsc", "ours"), structure=False)
    Report({"table1": table1}).write(tmp_path)
    page = Shown(browser, tmp_path / "index.html", viewport={"width": 1200, "height": 800}).page
    heads = page.locator("#table1 .grid thead th[colspan]:visible")
    assert heads.all_inner_texts() == ["SSC(2D)", "EDSC", "Ours"]
    page.get_by_role("checkbox", name="SSC(2D), share .7").check()
    assert heads.all_inner_texts()[1] == "SSC(2D), share .7"
    page.get_by_role("checkbox", name="Ours").uncheck()
    assert "Ours" not in heads.all_inner_texts()
    page.get_by_role("button", name="All columns").click()
    assert page.locator("#table1 .grid tbody tr").first.locator("td:visible").count() == len(heads.all())
    page.context.close()


def test_an_address_opens_a_run(browser: Any, report: Path, shown: Shown) -> None:
    key = shown.page.locator("#table2 .grid button.open").nth(3).get_attribute("data-runs")
    shown.page.goto(f"{report.as_uri()}#run={key}")
    shown.page.reload()
    shown.page.wait_for_selector("dialog[open]")
    assert key in shown.page.inner_text("dialog .facts")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone_scrolls_one_way_and_follows_the_theme(browser: Any, report: Path, scheme: str) -> None:
    phone = Shown(browser, report, viewport={"width": 390, "height": 800}, color_scheme=scheme, has_touch=True)
    wide = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert phone.page.evaluate(wide) <= 0
    ground = phone.page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, ground[4:-1].split(","))) < 200) == (scheme == "dark")
    phone.page.locator("#theme").tap()
    assert phone.page.evaluate("getComputedStyle(document.body).backgroundColor") != ground
    phone.page.locator("#table2 .grid button.open").first.tap()
    phone.frame()
    assert phone.page.evaluate("document.querySelector('dialog').scrollWidth") <= 390
    assert phone.troubles == []
    phone.page.context.close()
