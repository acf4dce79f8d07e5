"""Sweeps are composed as Hydra composes them: every form of an override, in any order, with folders of one's own."""

from __future__ import annotations

import itertools
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.types import RunMode
from omegaconf import open_dict

from nrsfm.harness.config.compose import configurations
from nrsfm.harness.config.jobs import plain_jobs, resolved
from nrsfm.harness.config.spans import spanned
from nrsfm.harness.record.errors import UsageError
from tests.shell import Shell, records

#: Every form of Hydra's grammar, on groups and on keys: set, add, add or set, remove, packages, lists, mappings,
#: quotes, interpolations, and each kind of sweep. Some are refused, alone or beside others.
FORMS = (
    "method=edsc",
    "method=edsc,mine",
    "method='edsc',\"mine\"",
    "method=choice(mine,adaptive)",
    "method=glob(ssc2*)",
    "method=glob(*,exclude=[a*,b*,l*,o*,p*,ssc2*])",
    "method=mine",
    "method=everywhere,edsc",
    "+method@other=edsc",
    "~method",
    "~method.clusterer",
    "method.name=own",
    "+method.how=a,b",
    "++method.name=x",
    "++method.more={a: 1, b: [2, 3]}",
    "dataset=dance_yoga",
    "dataset=procedural,dance_yoga",
    "+dataset@scene=tracks",
    "dataset.name='a b'",
    "dataset.placement=[1,2,3],paper",
    "dataset.bodies=[face,heart]",
    "dataset.bodies.0=person",
    "dataset.points=range(8,12,2)",
    "dataset.points=8",
    "noise.level=0,0.02",
    "noise.level=sort(0.5,0.1)",
    "noise.level=interval(0,1)",
    "noise={level: 0.5}",
    "noise={level: 0.5},{repeat: 2}",
    "noise.repeat=${n_bodies}",
    "gaps=random",
    "~gaps",
    "~gaps=none",
    "n_bodies=null,2",
    "n_bodies=auto",
    "limits={seconds: 5}",
    "limits.seconds=1e2",
    "~sweep",
    "+own={a: ${n_bodies}}",
    "output='a?b#c%20d'",
    "pairs='dance_yoga,face_yoga'",
    "tracking=server",
    "tracking.uri=sqlite:///a.db",
    "compare.against=published",
    "experiment=quick",
    "experiment=mine",
    "experiment=null",
    "hydra/launcher=joblib",
    "hydra.job.name=other",
    "hydra.verbose=true,false",
    "+hydra.job.env_set.A=1",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of configurations with a method, a method that stands at the top, and an experiment."""
    root = tmp_path_factory.mktemp("own") / "a?b #%20,'c"
    for group in ("method", "experiment"):
        (root / group).mkdir(parents=True)
    (root / "method/mine.yaml").write_text("# Mine.\ndefaults: [edsc, _self_]\nname: mine\n")
    (root / "method/everywhere.yaml").write_text("# @package _global_\nmethod: {name: everywhere}\nthreads: 2\n")
    (root / "experiment/mine.yaml").write_text(
        "# @package _global_\n# Mine.\ndefaults:\n  - override /method: mine\nexperiment: mine\n"
        "levels: 0,0.1\nhydra:\n  mode: MULTIRUN\n  sweeper:\n    params:\n"
        "      noise.level: ${levels}\n      dataset.points: 8,9\n"
    )
    return root


def added(folder: Path) -> str:
    quoted = str(folder).replace("'", "\\'")
    return f"hydra.searchpath=['file://{quoted}']"


def of_hydra(words: Sequence[str]) -> list[dict[str, Any]]:
    """The configurations of the jobs of ``--multirun``, each composed by Hydra's own sweeper."""
    with configurations(words):
        loader = GlobalHydra.instance().config_loader()
        master = loader.load_configuration("config", list(words), RunMode.MULTIRUN)
        params = [f"{key}={value}" for key, value in (master.hydra.sweeper.params or {}).items()]
        task = [word for word in words if not word.lstrip("+").startswith("hydra")]
        parsed = OverridesParser.create(loader).parse_overrides([*params, *task])
        configs = []
        for job in itertools.chain(*BasicSweeper.split_arguments(parsed, None)):
            config = loader.load_sweep_config(master, job)
            with open_dict(config):
                del config["hydra"]
            configs.append(resolved(config))
        return configs


def outcome(words: Sequence[str], whole: bool) -> list[dict[str, Any]] | str:
    try:
        return of_hydra(words) if whole else list(plain_jobs(spanned(words)))
    except UsageError:
        return "refused"


def drawn(seed: int, folder: Path) -> list[str]:
    """A few forms in random order, few enough that most can stand together."""
    generator = random.Random(seed)
    words = [*generator.sample(FORMS, generator.randint(2, 4)), added(folder)]
    return generator.sample(words, len(words))


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(n, marks=pytest.mark.slow) for n in range(4, 60))])
def test_any_overrides_in_any_order_are_composed_as_by_hydra(seed: int, folder: Path) -> None:
    words = drawn(seed, folder)
    assert outcome(words, whole=False) == outcome(words, whole=True), words


def test_every_verb_takes_a_folder_of_configurations(nrsfm: Shell, folder: Path, tmp_path: Path) -> None:
    words = ("dataset.frames=12", "dataset.points=8", "--config-dir", str(folder))
    assert nrsfm("run", "experiment=mine", *words).returncode == 0
    methods = {record["method"] for record in records(tmp_path).values()}
    assert methods == {"mine"} and len(records(tmp_path)) == 2
    done = nrsfm("run", "method=mine,edsc", "noise.level=0", *words)
    assert done.returncode == 0 and "1 run, 1 done before" in done.stdout
    assert "2 done" in nrsfm("plan", "experiment=mine", *words).stdout
    assert "2 of 4 cells measured" in nrsfm("report", "mine", "--quiet", *words).stdout
    reason = ("--reason", "first", str(tmp_path / "mine.json"), "experiment=mine")
    assert nrsfm("bless", *reason, *words).returncode == 0
    held = nrsfm("compare", "experiment=mine", f"compare.baseline={tmp_path}/mine.json", *words)
    assert held.returncode == 0, held.stderr
    both = nrsfm("run", *words, f"hydra.searchpath=[{folder}]")
    assert both.returncode == 3 and "hydra.searchpath" in both.stderr


@pytest.mark.slow
def test_workers_of_another_launcher_know_the_folder(nrsfm: Shell, folder: Path, tmp_path: Path) -> None:
    words = ("dataset.frames=12", "dataset.points=8", "--config-dir", str(folder), "hydra/launcher=joblib")
    done = nrsfm("run", "experiment=mine", *words)
    assert done.returncode == 0, done.stderr
    assert len(records(tmp_path)) == 2


def test_a_glob_takes_the_files_that_there_are() -> None:
    assert [job[-1] for job in spanned(["method=glob(ssc2d*,exclude=*share*)"])] == ["method=ssc2d", "method=ssc2d_bmm"]
