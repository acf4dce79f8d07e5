"""The page in a real browser, headless: it opens, sorts, opens runs, plays, and shows foreign text as text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.report import Report, write
from tests.conftest import chromium
from tests.reports.conftest import full, make_answer

pytestmark = pytest.mark.browser

EVIL = "<img src=x onerror=document.title='broken'></script><script>document.title='broken'</script>"
SOFTWARE_GL = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")


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
    table2[0] = (table2[0][0], replace(table2[0][1], run_id=EVIL))
    folder = tmp_path_factory.mktemp("page")
    write(Report({"table1": table1, "table2": table2}, lambda _: arrays), folder)
    return folder / "index.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with api.sync_playwright() as playwright:
        shown = playwright.chromium.launch(executable_path=chromium(), args=SOFTWARE_GL)
        yield shown
        shown.close()


class Shown:
    """A page with what went wrong on it, and every address that it asked for."""

    def __init__(self, browser: Any, path: Path, **context: Any) -> None:
        self.troubles: list[str] = []
        self.asked: list[str] = []
        self.page = browser.new_context(**context).new_page()
        self.page.on("pageerror", lambda error: self.troubles.append(str(error)))
        self.page.on("console", lambda said: self.troubles.append(said.text) if said.type == "error" else None)
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(path.as_uri())

    def frame(self) -> int:
        self.page.wait_for_selector("dialog .view[data-frame]")
        return int(self.page.get_attribute("dialog .view", "data-frame"))

    def until(self, true: Callable[[], bool], seconds: float = 30) -> None:
        """Wait; the page's policy forbids Playwright's own way, a string that is evaluated."""
        for _ in range(int(20 * seconds)):
            if true():
                return
            self.page.wait_for_timeout(50)
        raise AssertionError("waited in vain")

    def scene(self) -> str:
        """The positions that the 3D view shows now."""
        return str(self.page.evaluate("JSON.stringify(document.querySelector('dialog .view').data.map(t => t.x))"))


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
    facts = page.inner_text("dialog .facts")
    assert "e_3d_dai" in facts
    assert "trial" in facts
    first, before = shown.frame(), shown.scene()
    page.keyboard.press(" ")  # the play button has the focus
    shown.until(lambda: shown.frame() > first + 2)
    assert shown.scene() != before
    page.keyboard.press(" ")
    page.wait_for_timeout(300)
    held = shown.frame()
    page.wait_for_timeout(400)
    assert shown.frame() == held
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
