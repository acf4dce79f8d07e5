"""The keys that the schema allows a dataset are those that the configuration gives it."""

from __future__ import annotations

from nrsfm.harness.config.schema import SOURCE_KEYS
from nrsfm.harness.config.spans import expand
from tests.shell import ROOT


def test_every_key_of_a_source_is_in_its_configuration_and_the_other_way_round() -> None:
    given: dict[str, set[str]] = {}
    for name in sorted(path.stem for path in (ROOT / "conf/dataset").glob("*.yaml")):
        files = {"tracks": ["dataset.file=tracks.npz"], "c3d": ["dataset.take=one"]}.get(name, [])
        for trial, _ in expand([f"dataset={name}", *files]):
            given.setdefault(trial.dataset["source"], set()).update(trial.dataset)
    assert {source: keys - {"source", "name"} for source, keys in given.items()} == {
        source: set(keys) for source, keys in SOURCE_KEYS.items()
    }
