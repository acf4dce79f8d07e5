"""Sources of scenes: the project's own, and modules of installed packages that fail."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from nrsfm.datasets import registry
from nrsfm.datasets.errors import DatasetError
from tests.shell import ROOT


@pytest.fixture
def plugin(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A source called ``other``, as if an installed package brought it."""
    module = SimpleNamespace(load=print, digest=lambda settings, folder: str(settings["stand_in"]), __name__="other")
    entry = SimpleNamespace(load=lambda: module, dist=None)
    monkeypatch.setattr(registry, "others", lambda: {"other": entry})
    return module


def test_every_configuration_names_a_source() -> None:
    for path in (ROOT / "conf/dataset").glob("*.yaml"):
        settings = yaml.safe_load(path.read_text())
        assert settings.get("source", "mocap") in registry.SOURCES or settings["defaults"]


def test_a_source_is_told_whether_stand_ins_are_allowed(plugin: SimpleNamespace) -> None:
    for allowed in (False, True):
        assert registry.digest({"source": "other"}, Path(), allowed) == str(allowed)


@pytest.mark.parametrize(
    ("error", "kind"),
    [(ZeroDivisionError("x"), DatasetError), (MemoryError(), MemoryError), (DatasetError("x"), DatasetError)],
)
def test_errors_of_a_plugin(plugin: SimpleNamespace, error: Exception, kind: type[Exception]) -> None:
    def load(settings: Any, folder: Path) -> None:
        raise error

    plugin.load = load
    with pytest.raises(kind) as caught:
        registry.load_scene({"source": "other"}, Path())
    if isinstance(error, ZeroDivisionError):
        assert str(caught.value) == "dataset other: load ended with ZeroDivisionError: x; mend other"


def test_a_defect_of_an_own_source_keeps_its_type() -> None:
    with pytest.raises(KeyError, match="bodies"):
        registry.load_scene({"source": "procedural"}, Path())


def test_a_source_that_is_not_there() -> None:
    with pytest.raises(DatasetError, match=r"dataset\.source is 'scene', wanted one of mocap, "):
        registry.source("scene")
    assert registry.provider("mocap") is None
    assert isinstance(registry.others(), dict)
    assert all(isinstance(entry, EntryPoint) for entry in registry.others().values())
