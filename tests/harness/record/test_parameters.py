"""Nested settings as flat parameters."""

from __future__ import annotations

from nrsfm.harness.config.spans import expand
from nrsfm.harness.record.parameters import flatten
from nrsfm.harness.record.trial import titles


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


def test_a_title_tells_a_trial_from_all_others_of_a_sweep() -> None:
    words = ["method=ours,edsc", "dataset.points=8,9", "noise.level=0,0.1", "noise.repeat=0,1", "n_bodies=null,auto"]
    trials = [trial for trial, _ in expand([*words, "method.name=own", "cameras=estimated", "cameras.rank=5,6"])]
    named = titles(trials)
    assert len(set(named)) == len(trials) == 48
    assert "person_face own noise=0.1#1 n_bodies=auto cameras=estimated dataset.points=9 " in " ".join(named)
    assert titles(trials[:1]) == [trials[0].title]
