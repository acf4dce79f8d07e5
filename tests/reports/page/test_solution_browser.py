"""The page of one reconstruction in a real browser: it plays, turns, and shows foreign text as text."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.scene import Scene
from nrsfm.harness.solving.solution import Solution
from nrsfm.methods.base import Reconstruction
from tests.reports.conftest import Shown

pytestmark = pytest.mark.browser

EVIL = "<img src=x onerror=document.title='broken'></script><script>document.title='broken'</script>"
F, P = 40, 12


def solution(truth: bool) -> Solution:
    """Random walks of two bodies, one of which has a name that is out to break the page."""
    S = np.cumsum(np.random.default_rng(0).standard_normal((F, 3, P)), axis=0)
    S -= S.mean(axis=2, keepdims=True)
    labels, cameras = np.repeat([0, 1], P // 2), orbit(F)
    scene = Scene(
        name="mine",
        tracks=project(cameras, S),
        bodies=("walker", EVIL),
        labels=labels,
        structure=S,
        cameras=cameras,
        track_ids=(EVIL, *(f"m{p}" for p in range(1, P))),
        frame_ids=tuple(f"t{f + 100}" for f in range(F)),
        notes=(EVIL,),
    )
    found = Reconstruction(
        labels=np.where(np.arange(P) == 3, 1, labels),
        structure=S + 0.1,
        cameras=cameras,
        affinity=np.ones((P, P)),
        history={"shape": np.exp(-np.arange(20.0)), "objective": np.arange(20.0)},
    )
    if not truth:
        scene = replace(scene, labels=None, structure=None, bodies=())
    return Solution(scene, found, "ours", {"tol": 1e-3}, "the file", not truth, 1.5)


def written(folder: Path, truth: bool) -> Path:
    path = folder / "view.html"
    path.write_text(solution(truth).page(), encoding="utf-8")
    return path


@pytest.mark.parametrize("truth", [True, False], ids=["truth", "no truth"])
def test_it_says_what_was_found_and_plays(truth: bool, browser: Any, tmp_path: Path) -> None:
    path = written(tmp_path, truth)
    shown = Shown(browser, path, viewport={"width": 1200, "height": 900})
    page = shown.page
    first, before = shown.frame(), shown.scene()
    assert page.title() == page.inner_text("h1") == "mine"
    facts = page.inner_text("aside")
    assert f"{P}, none of the observations missing" in facts and "below the tolerance" in facts
    assert ("e_MS" in facts) == truth
    names = page.evaluate("document.querySelector('.view').data.map(t => t.name)")
    if truth:
        assert names[:2] == ["ground truth", "walker (5 tracks)"] and names[-1] == "wrong label (1)"
        assert names[2].startswith(EVIL[:50]) and names[2].endswith("(7 tracks)")
    else:
        assert names == ["body 1 (5 tracks)", "body 2 (7 tracks)"]
    hovered = page.evaluate("document.querySelector('.view').data.map(t => t.text)")
    assert hovered[1 if truth else 0][:3] == [EVIL[:59].rstrip() + "…", "m1", "m2"]
    assert page.inner_text("output") == f"frame 1 of {F} (t100)"
    page.get_by_role("button", name="Play").click()
    shown.until(lambda: shown.frame() > first + 2)
    assert shown.scene() != before
    page.get_by_role("button", name="Pause").click()
    page.locator("input[type=range]").fill("9")
    shown.until(lambda: shown.frame() == 9)
    assert page.inner_text("output") == f"frame 10 of {F} (t109)"
    up = "document.querySelector('.view')._fullLayout.scene.camera.up.z"
    assert page.evaluate(up) == 1
    page.get_by_role("button", name="Turn over").click()
    shown.until(lambda: page.evaluate(up) == -1)
    page.locator("#plots .js-plotly-plot").last.scroll_into_view_if_needed()
    assert page.locator("#plots .js-plotly-plot").count() == (4 if truth else 3)
    assert page.locator("img").count() == 0 and EVIL[:30] in facts
    assert {url for url in shown.asked if not url.startswith(("data:", "blob:"))} == {path.as_uri()}
    assert shown.troubles == []


def test_a_phone_scrolls_one_way_and_a_metre_is_a_metre(browser: Any, tmp_path: Path) -> None:
    viewport = {"width": 390, "height": 800}
    phone = Shown(browser, written(tmp_path, False), viewport=viewport, color_scheme="light", has_touch=True)
    phone.frame()
    wide = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert phone.page.evaluate(wide) <= 0
    box = "document.querySelector('.view')"
    assert phone.page.evaluate(f"{box}.querySelector('.svg-container').clientWidth - {box}.clientWidth") <= 0
    ratios = phone.page.evaluate(
        f"""(() => {{ const s = {box}._fullLayout.scene, span = (a) => s[a + 'axis'].range[1] - s[a + 'axis'].range[0];
        return ['x', 'y', 'z'].map((a) => s.aspectratio[a] / span(a)); }})()"""
    )
    np.testing.assert_allclose(ratios, ratios[0], rtol=1e-6)
    assert phone.page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    phone.page.context.close()
