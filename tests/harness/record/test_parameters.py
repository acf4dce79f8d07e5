"""Nested settings as flat parameters."""

from __future__ import annotations

from nrsfm.harness.record.parameters import flatten


def test_nested_settings_become_dotted_names_in_order() -> None:
    tree = {
        "method": {"clusterer": {"alpha": 800.0, "name": None}, "l1": 1},
        "cameras": {},
        "bodies": ["dance", "yoga"],
    }
    assert flatten(tree) == {
        "method.clusterer.alpha": 800.0,
        "method.clusterer.name": None,
        "method.l1": 1,
        "bodies": ["dance", "yoga"],
    }
    assert list(flatten(tree))[-1] == "bodies"


def test_a_number_as_name_is_text() -> None:
    assert flatten({"steps": {1: "a"}}) == {"steps.1": "a"}
