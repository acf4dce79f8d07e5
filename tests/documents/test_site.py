"""The site is built without a warning, opens without network, and has no dead link."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
import yaml

from nrsfm.harness.cli.verbs import VERBS
from tests.documents.documents import CONF, ROOT

FILES = sorted(CONF.rglob("*.yaml"))


def extension(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / f"docs/extensions/{name}.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def generated() -> ModuleType:
    pytest.importorskip("sphinx", reason="the extra 'docs' is not installed")
    return extension("generated")


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(CONF)))
def test_every_key_is_described_with_its_default(generated: ModuleType, path: Path) -> None:
    """The reference has every key of a file, each with its value and a description."""
    about, keys = generated.described(path)
    assert " ".join(about).strip()
    folded = {key.name for key in keys if key.value.startswith(">")}
    written = _flat({key.name: yaml.safe_load(key.value) for key in keys if key.name not in folded})
    wanted = _flat(yaml.safe_load(path.read_text(encoding="utf-8")))
    assert written == {name: value for name, value in wanted.items() if name not in {"defaults", *folded}}
    plain = ("source", "name", "algorithm", "uri")  # what they are stands in the file's first line
    explained = [
        key for key in keys if path.parent.name != "experiment" and not key.name.startswith(("hydra", "tolerances"))
    ]
    assert not [key.name for key in explained if not key.comment and key.name not in plain]


def _flat(tree: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in tree.items():
        found |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found


def test_every_verb_is_described(generated: ModuleType) -> None:
    text = generated.commands()
    for verb in VERBS:
        assert f"## nrsfm {verb}\n" in text
    assert text.count("```text") >= len(VERBS)
    assert text.count("usage: nrsfm") > len(VERBS)


def test_formulas_of_docstrings_are_no_markup() -> None:
    pytest.importorskip("sphinx", reason="the extra 'docs' is not installed")
    plain = extension("docstrings").plain
    lines = ["|E|_1 and labels_ of ``a*b|c``, :func:`soft`.", "", "    min |X|_*", "", "Parameters", "----------"]
    assert plain([*lines, "x : int", "    X' *"]) == [
        r"\|E\|_1 and labels\_ of ``a*b|c``, :func:`soft`.",
        "",
        "::",
        "",
        "    min |X|_*",
        "",
        "Parameters",
        "----------",
        "x : int",
        r"    X' \*",
    ]


class Page(HTMLParser):
    """Resources that a page loads, its links, and the names that links can point to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.asked: list[str] = []
        self.links: list[str] = []
        self.names: set[str] = set()
        self.drawn = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.drawn += tag == "svg" and "aria-label" in given
        if tag == "a" and given.get("href"):
            self.links.append(str(given["href"]))
        elif tag != "a":
            kinds = ("stylesheet", "icon", "preload", None)
            own = [given.get("src"), given.get("href") if given.get("rel") in kinds else None]
            self.asked += [place for place in own if place]
        self.names |= {str(given[key]) for key in ("id", "name") if given.get(key)}


@pytest.mark.site
def test_the_site_is_built_without_a_warning_and_stands_alone(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="the extra 'docs' is not installed")
    words = ("--quiet", "--fail-on-warning", "--keep-going", "--builder", "html", "--doctree-dir", tmp_path / "trees")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *map(str, words), ROOT / "docs", tmp_path / "site"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in (tmp_path / "site").rglob("*.html")}
    assert len(pages) > 25
    for path, page in pages.items():
        for place in page.asked:
            assert not urlsplit(place).netloc, f"{path.name} asks the network for {place}"
            assert place.startswith("data:") or (path.parent / unquote(urlsplit(place).path)).exists(), (path, place)
        for link in page.links:
            to = urlsplit(link)
            if to.scheme or to.netloc:
                continue
            target = (path.parent / unquote(to.path)).resolve() if to.path else path
            assert target.exists(), (path, link)
            if to.fragment and target in pages:
                assert unquote(to.fragment) in pages[target].names | {""}, (path, link)
    for style in (tmp_path / "site").rglob("*.css"):
        assert not re.search(r"(url\(|@import)\s*[\"']?(https?:)?//", style.read_text(encoding="utf-8")), style
    assert pages[(tmp_path / "site/methods/ours.html")].drawn > 20
