"""A trial: its key, its record, and what becomes of it when things go wrong."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from nrsfm.datasets.real.hopkins import SCENES
from nrsfm.datasets.registry import load_scene
from nrsfm.harness.config.compose import compose_config
from nrsfm.harness.config.jobs import plain_jobs, resolved
from nrsfm.harness.config.settings import Settings
from nrsfm.harness.config.spans import expand, spanned
from nrsfm.harness.evaluate import reconstruct
from nrsfm.harness.record import folder as storage
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.record.trial import OPTIONAL, Trial, digest
from nrsfm.harness.trial import worker
from nrsfm.harness.trial.execute import execute
from nrsfm.harness.trial.identity import identify
from nrsfm.methods.base import MethodError
from nrsfm.methods.clustering.edsc import EDSC
from nrsfm.methods.pipelines import ClusterTracks


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(
        output=tmp_path / "out", data=tmp_path / "data", tracking_uri=f"sqlite:///{tmp_path}/out/mlflow.db", sweep="s"
    )


@pytest.fixture(scope="module")
def trial() -> Trial:
    return expand(["dataset.points=8", "dataset.frames=12", "method=edsc"])[0][0]


def test_runs_once_and_keeps_everything(trial: Trial, settings: Settings) -> None:
    outcome, ran = execute(trial, settings)
    assert ran
    assert outcome.status == "ok"
    folder = settings.trials / outcome.key
    assert json.loads((folder / storage.RESULT).read_text())["key"] == outcome.key
    with np.load(folder / storage.ARRAYS, allow_pickle=False) as arrays:
        assert arrays["labels"].shape == (16,)
        assert arrays["tracks"].shape == (12, 2, 16)
    assert outcome.metrics["n_wrong"] == round(outcome.metrics["e_ms"] * 16)
    assert outcome.peak_mb is not None and outcome.peak_mb > 10
    assert outcome.environment["numpy"] == np.__version__
    again, ran = execute(trial, settings)
    assert not ran
    assert again == outcome


def test_same_trial_gives_the_same_numbers(trial: Trial, settings: Settings) -> None:
    first, _ = execute(trial, settings)
    second, ran = execute(trial, replace(settings, rerun="all"))
    assert ran
    assert first.metrics == second.metrics


def test_key_follows_what_matters(trial: Trial, settings: Settings) -> None:
    key = identify(trial, settings).key
    elsewhere = replace(settings, output=settings.output / "x", threads=2, seconds=1, sweep="t", tracking_uri="u")
    assert identify(trial, elsewhere).key == key
    changed = [
        replace(trial, noise={"level": 0.01, "repeat": 0}),
        replace(trial, noise={"level": 0.0, "repeat": 1}),
        replace(trial, cameras={"source": "estimated"}),
        replace(trial, n_bodies=3),
        replace(trial, dataset={**trial.dataset, "seed": 1}),
        replace(trial, method={**trial.method, "clusterer": {**trial.method["clusterer"], "power": 3.0}}),
    ]
    keys = {identify(t, settings).key for t in changed}
    assert len(keys) == len(changed)
    assert key not in keys


def test_key_follows_the_version_of_the_method(
    trial: Trial, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = identify(trial, settings).key
    monkeypatch.setattr("nrsfm.methods.pipelines.ClusterTracks.version", "2")
    assert identify(trial, settings).key != key


def test_the_identity_is_carried_and_not_computed_again(trial: Trial, settings: Settings) -> None:
    identity = replace(identify(trial, settings), key="0123456789abcdef")
    outcome, ran = execute(trial, settings, identity)
    assert (ran, outcome.status, outcome.key) == (True, "ok", identity.key)
    assert outcome.environment["data"] == identity.data
    assert execute(trial, settings, identity) == (outcome, False)


def test_data_that_change_after_the_identity_are_refused(tmp_path: Path, settings: Settings) -> None:
    """A trial never records results of other data than its key names; the next start gives it a new key."""
    x = np.random.default_rng(0).standard_normal((3, 12, 8))
    file = tmp_path / "data/hopkins155/arm_truth.mat"
    file.parent.mkdir(parents=True)
    scipy.io.savemat(file, {"x": x, "s": np.repeat([[1], [2]], 6, axis=0)})
    ((trial, _),) = expand(["dataset=hopkins155", "dataset.scene=arm", "method=edsc_raw"])
    identity = identify(trial, settings)
    scipy.io.savemat(file, {"x": x + 1, "s": np.repeat([[1], [2]], 6, axis=0)})
    outcome, _ = execute(trial, settings, identity)
    assert (outcome.key, outcome.status) == (identity.key, "failed")
    assert outcome.error == "the data of hopkins155_arm changed after this run began; start it again"
    again, ran = execute(trial, settings)
    assert (ran, again.status) == (True, "ok") and again.key != identity.key


def test_a_trial_reports_its_stages(settings: Settings) -> None:
    """Besides those of its method: making the scene, estimating cameras, measuring errors."""

    class Listener:
        def __init__(self) -> None:
            self.stages: list[str] = []

        def stage(self, name: str) -> None:
            self.stages.append(name)

        def __call__(self, *iteration: object) -> None:
            pass

    estimation = {"known": [], "estimated": ["cameras"], "refined": ["cameras", "cameras and structure"]}
    for cameras, before in estimation.items():
        words = ["dataset.points=8", "dataset.frames=12", "method=bmm_ssc3d", f"cameras={cameras}"]
        ((trial, _),) = expand(words)
        listener = Listener()
        blank = Outcome("k", "s", "failed", "d", "m", cameras, "", "", 0.0, 0)
        worker.compute(trial, blank, settings.data, False, progress=listener)
        own = ["method", "structure", "clustering", "metrics"]
        assert listener.stages == ["scene", *before, *own]


def test_damaged_record_counts_as_not_done(trial: Trial, settings: Settings) -> None:
    outcome, _ = execute(trial, settings)
    path = settings.trials / outcome.key / storage.RESULT
    path.write_text(path.read_text()[:40])
    again, ran = execute(trial, settings)
    assert ran
    assert again.status == "ok"


def test_absent_sequence_is_a_row_that_says_how_to_get_it(settings: Settings) -> None:
    trial = expand(["dataset=dance_yoga", "method=edsc"])[0][0]
    outcome, _ = execute(trial, settings)
    assert outcome.status == "absent"
    assert "dance.mat is not there" in outcome.error
    assert "nrsfm data get" in outcome.error
    assert "\n" not in outcome.error


def test_scenes_without_cameras_are_for_methods_that_need_none(tmp_path: Path, settings: Settings) -> None:
    x = np.random.default_rng(0).standard_normal((3, 12, 8))
    file = tmp_path / "data/hopkins155/arm_truth.mat"
    file.parent.mkdir(parents=True)
    scipy.io.savemat(file, {"x": x, "s": np.repeat([[1], [2]], 6, axis=0)})
    for words in (["cameras=known"], ["cameras=estimated"]):
        (trial, _), (ours, _) = expand(["dataset=hopkins155", "dataset.scene=arm", "method=edsc_raw,adaptive", *words])
        outcome, _ = execute(trial, settings)
        assert (outcome.status, outcome.dataset) == ("ok", "hopkins155_arm")
        assert {"e_ms", "n_wrong"} <= outcome.metrics.keys() and "e_3d" not in outcome.metrics
        needy, _ = execute(ours, settings)
        assert (needy.status == "ok") == (words == ["cameras=estimated"])
        assert "cameras=estimated" in needy.error or needy.status == "ok"


def test_no_cameras_are_estimated_for_a_method_that_needs_none(settings: Settings) -> None:
    """Three frames of a plane: no camera can be had from them."""
    words = ["dataset.points=8", "dataset.frames=2", "cameras=estimated", "method=edsc,adaptive"]
    (edsc, _), (ours, _) = expand(words)
    assert execute(edsc, settings)[0].status == "ok"
    assert "at least 3" in execute(ours, settings)[0].error


def test_hopkins155_asks_for_every_scene() -> None:
    asked = [trial for trial, _ in expand(["experiment=hopkins155"])]
    for method in ("ssc_raw", "ssc_raw_4n", "edsc_raw"):
        scenes = [trial.dataset["scene"] for trial in asked if trial.method["name"] == method]
        assert sorted(scenes) == sorted(SCENES)
        assert [t.dataset["name"] for t in asked if t.method["name"] == method] == [f"hopkins155_{s}" for s in scenes]


@pytest.mark.parametrize(
    "words",
    [
        pytest.param(["experiment=table1"], marks=pytest.mark.slow),
        ["experiment=table1", "dataset.motion=native", "dataset.placement=[3,0,0]"],
        ["experiment=quick"],
        ["experiment=single_body"],
        ["method=adaptive,edsc,bmm_ssc3d", "dataset=procedural,dance_yoga", "cameras=known,estimated"],
        ["experiment=hopkins155", "dataset.scene=arm,three-cars"],
        ["method=adaptive,edsc", "noise.level=0,0.02", "+method.how=a"],
        ["~method.clusterer", "method=edsc", "dataset.points=8,9"],
        ["dataset=mocap_scene", "dataset.bodies=[drink,stretch],[dance,yoga]", "dataset.frames=null,10"],
        ["dataset.name='a b'", "n_bodies=2,3", "cameras=known,estimated"],
        ["method=adaptive", "method.l1=${noise.level}", "noise.level=0,0.5"],
        ["noise.level=0.1,0.2", "noise={level: 0.5}"],
        ["dataset=mocap_body", "dataset.body=drink,yoga", "method=bmm,pta"],
        ["output=a,b", "noise.level=0,0.1"],
        ["method=adaptive,edsc,bmm", "dataset=procedural,dance_yoga", "noise.level=0,0.1", "cameras=known,estimated"],
        ["dataset.bodies=[face],[face,heart]", "dataset.bodies.0=person", "dataset.frames='20',30"],
        ["noise.level=0,0.1", "+method.how=a", "tracking.uri=sqlite:///a.db"],
        ["dataset.points=8,9", "method.l1='0.5',0.25", "limits.seconds=5,null", "dataset.placement=paper,[1,2,3]"],
    ],
)
def test_configurations_are_those_of_hydra(words: list[str]) -> None:
    """Composed together or one by one."""
    jobs = spanned(words)
    assert list(plain_jobs(jobs)) == [resolved(compose_config(job)) for job in jobs]


def test_a_value_that_is_missing_is_asked_for_by_its_key() -> None:
    """Jobs that give it are put together, one that does not is refused as by itself."""
    given = ["method=edsc", "dataset=tracks", "dataset.file=a.npz"]
    jobs = [[*given, "noise.level=0"], [*given, "noise.level=0.5"], given[:2]]
    found = plain_jobs(jobs)
    assert [next(found)["noise"]["level"] for _ in range(2)] == [0, 0.5]
    with pytest.raises(UsageError) as alone:
        resolved(compose_config(jobs[2]))
    with pytest.raises(UsageError) as together:
        next(found)
    assert str(together.value) == str(alone.value)
    assert "dataset.file" in str(alone.value)


@pytest.mark.parametrize("job", [["noise.laut=1"], ["dataset.scene=arm"], ["method=none"], ["noise.level"]])
def test_configurations_are_refused_as_hydra_does(job: list[str]) -> None:
    with pytest.raises(UsageError) as whole:
        compose_config(job)
    with pytest.raises(UsageError) as together:
        list(plain_jobs([["noise.level=0"], job]))
    assert str(together.value) == str(whole.value)


def test_stand_in_is_labelled_and_has_another_key(settings: Settings) -> None:
    trial = expand(["dataset=dance_yoga", "method=edsc"])[0][0]
    allowed = replace(settings, missing="stand_in")
    outcome, _ = execute(trial, allowed)
    assert outcome.status == "ok"
    assert outcome.stand_in
    assert (outcome.n_points, outcome.n_frames) == (116, 264)
    assert identify(trial, allowed).key != identify(trial, settings).key


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["dataset.bodies=[person]", "n_bodies=2"], "has 1 body and n_bodies is 2"),
        (["dataset.bodies=[person]"], "segmentation needs 2"),
        (["dataset.bodies=[ghost]"], "ghost"),
        (["dataset.points=0"], "dataset.points"),
        (["dataset.placement=far"], "dataset.placement"),
        (["method.clusterer.weight=-1"], "weight"),
        (["method.algorithm=magic"], "magic"),
    ],
)
def test_impossible_trials_are_rows_with_one_clear_line(settings: Settings, overrides: list[str], words: str) -> None:
    trial = expand(["dataset.points=8", "dataset.frames=12", "method=edsc", *overrides])[0][0]
    outcome, _ = execute(trial, settings)
    assert outcome.status == "failed"
    assert words in outcome.error
    assert "\n" not in outcome.error
    assert not (settings.trials / outcome.key / storage.TRACEBACK).exists()


def test_gaps_from_the_configuration_to_the_metrics(settings: Settings) -> None:
    words = ["dataset.points=12", "dataset.frames=24", "method=bmm_ssc3d", "gaps=stretches", "gaps.share=0.2"]
    known, estimated = (trial for trial, _ in expand([*words, "cameras=known,estimated"]))
    for trial in (known, estimated):
        assert trial.gaps == {"kind": "stretches", "share": 0.2, "length": 20} and "gaps=stretches 0.2" in trial.title
        outcome, _ = execute(trial, settings)
        assert outcome.status == "ok", outcome.error
        assert {"e_3d", "e_3d_visible", "e_3d_hidden", "e_ms"} <= outcome.metrics.keys()
        assert outcome.parameters["gaps"] == trial.gaps
    with np.load(settings.trials / outcome.key / storage.ARRAYS) as arrays:
        assert (~arrays["visible"]).mean() == pytest.approx(0.2, abs=0.01)
        assert (np.isnan(arrays["tracks"]).any(axis=1) == ~arrays["visible"]).all()


def test_gaps_of_nothing_are_no_setting() -> None:
    """A trial without gaps is the same whichever way it says so, and the same as before there were any."""
    plain, *others = (
        expand(["method=edsc", *words])[0][0]
        for words in ([], ["gaps=random", "gaps.share=0"], ["gaps.length=9"], ["gaps.share=0.3"])
    )
    assert {trial.setting for trial in others} == {plain.setting} and not plain.gaps
    before = {name: value for name, value in asdict(plain).items() if name not in OPTIONAL}
    assert plain.setting == digest(before)


def test_corruption_and_cleaning_from_the_configuration_to_the_arrays(settings: Settings) -> None:
    words = [
        "dataset.points=12",
        "dataset.frames=24",
        "method=bmm_ssc3d",
        "corruption=outliers_05",
        "corruption.zoom=0.2",
    ]
    given, cleaned = (trial for trial, _ in expand([*words, "observations=as_given,cleaned"]))
    assert given.corruption == cleaned.corruption and "outliers 0.05, smooth zoom 0.2" in given.title
    assert not given.observations and "robust, scale" in cleaned.title and given.setting != cleaned.setting
    worse, better = (execute(trial, settings)[0] for trial in (given, cleaned))
    assert worse.status == better.status == "ok", better.error
    assert better.gaps == "outliers 0.05, smooth zoom 0.2, robust, scale" != worse.gaps
    assert better.metrics["e_3d"] < worse.metrics["e_3d"]
    arrays = storage.read_arrays(settings.trials / better.key / storage.ARRAYS)
    assert 0.02 < arrays["outliers"].mean() < 0.1 and np.ptp(arrays["scales"]) > 0.2
    assert "scales" not in storage.read_arrays(settings.trials / worse.key / storage.ARRAYS)


def test_corruption_of_nothing_is_no_setting() -> None:
    plain, *others = (
        expand(["method=edsc", *words])[0][0]
        for words in ([], ["corruption=zoom", "corruption.zoom=0"], ["corruption.zooming=random"])
    )
    assert {trial.setting for trial in others} == {plain.setting} and not plain.corruption
    switched = expand(["method=edsc", "observations=cleaned", "observations.robust=false", "observations.scale=false"])
    assert switched[0][0].setting == plain.setting


def test_a_method_without_gap_handling_gets_completed_tracks(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where outliers were taken out of whole tracks."""
    scene = load_scene(expand(["dataset.points=12", "dataset.frames=24", "method=edsc"])[0][0].dataset, settings.data)
    monkeypatch.setattr(ClusterTracks, "handles_gaps", False)
    robust = {"robust": True, "scale": False}
    spoilt = scene.with_corruption(outliers=0.05)
    found = reconstruct.reconstruct(spoilt, ClusterTracks(EDSC()), 2, {"source": "known"}, robust)
    assert found.cleaned is not None and found.cleaned.visible is not None and found.labels is not None


def test_a_method_that_does_not_handle_gaps_is_never_given_any(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["dataset.points=12", "dataset.frames=24", "method=edsc"]
    scene = load_scene(expand(words)[0][0].dataset, settings.data)
    monkeypatch.setattr(ClusterTracks, "handles_gaps", False)
    known = {"source": "known"}
    assert reconstruct.reconstruct(scene, ClusterTracks(EDSC()), 2, known).labels is not None
    with pytest.raises(MethodError, match="ClusterTracks cannot work with gaps"):
        reconstruct.reconstruct(scene.with_gaps("random", 0.1), ClusterTracks(EDSC()), 2, known)


@pytest.mark.parametrize("bodies", [["person", "face"], ["person"]])
def test_a_method_counts_the_bodies_when_it_is_asked_to(settings: Settings, bodies: list[str]) -> None:
    words = ["dataset.points=12", "dataset.frames=20", f"dataset.bodies=[{','.join(bodies)}]", "n_bodies=auto"]
    for trial, _ in expand([*words, "method=edsc,bmm"]):
        outcome, _ = execute(trial, settings)
        assert outcome.status == "ok" and "n_bodies=auto" in trial.title
        if trial.method["name"] == "bmm":
            assert outcome.n_bodies is None and "n_bodies_found" not in outcome.metrics
            continue
        found = outcome.metrics["n_bodies_found"]
        assert found == outcome.n_bodies and outcome.metrics["miscounted"] == (found != len(bodies))
        assert outcome.metrics["eigengap"] >= 0
        assert outcome.metrics["n_wrong"] >= 24 * (found != 2) / 3 if len(bodies) == 2 else found >= 1


@pytest.mark.parametrize(
    "overrides",
    [
        ["noise.level=-1"],
        ["noise=1"],
        ["noise.repeat=0.5"],
        ["gaps=random", "gaps.share=1"],
        ["gaps=random", "gaps.share=some"],
        ["gaps.kind=holes"],
        ["n_bodies=zero"],
        ["n_bodies=0"],
        ["n_bodies=true"],
        ["limits.seconds=0"],
        ["rerun=maybe"],
        ["nonsense=1"],
        ["dataset.placement=[1,2]"],
        ["method.name=a/b"],
        ["sweep=../x"],
        ["~cameras"],
    ],
)
def test_impossible_settings_are_refused_before_anything_runs(overrides: list[str]) -> None:
    with pytest.raises(UsageError):
        expand(overrides)


def test_sweep_parameters_of_an_experiment_can_be_overridden() -> None:
    full = expand(["experiment=table1"])
    assert len(full) == 64
    few = expand(["experiment=table1", "method=adaptive,edsc", "dataset=face_yoga", "dataset.motion=native"])
    assert [(t.dataset["name"], t.method["name"]) for t, _ in few] == [("face_yoga", "adaptive"), ("face_yoga", "edsc")]
    assert {t.dataset["motion"] for t, _ in few} == {"native"}


def test_single_bodies_take_the_published_rank() -> None:
    trials = [trial for trial, _ in expand(["experiment=single_body"])]
    assert len(trials) == 48
    ranks = {"drink": 12, "pickup": 12, "yoga": 10, "stretch": 11, "dance": 10, "face": 7, "walking": 8, "shark": 4}
    assert {t.dataset["name"]: t.method["rank"] for t in trials if t.method["name"] == "bmm"} == ranks
    basis = {"drink": 13, "pickup": 12, "yoga": 11, "stretch": 12, "dance": 5, "face": 5, "walking": 2, "shark": 9}
    assert {t.dataset["name"]: t.method["rank"] for t in trials if t.method["name"] == "pta"} == basis
    estimated = [t for t in trials if t.cameras["source"] == "estimated"]
    assert len(estimated) == 24
    assert all(t.cameras["rank"] == t.method["rank"] for t in estimated)
    [(own, _)] = expand(["dataset=mocap_body", "dataset.body=yoga", "cameras=estimated", "cameras.rank=3"])
    assert (own.cameras["rank"], own.dataset["rank"], own.dataset["name"]) == (3, 10, "yoga")
    [(scene, _)] = expand(["dataset=dance_yoga", "cameras=estimated"])
    assert scene.cameras == {"source": "estimated", "rank": 11, "start": "trace_norm", "refine": True}
    ablation = [trial for trial, _ in expand(["experiment=rotation_ablation"])]
    assert len(ablation) == 40
    assert {t.dataset["name"]: t.method["rank"] for t in ablation} == ranks
    shark = [(t.cameras["rank"], t.cameras["start"], t.cameras["refine"]) for t in ablation if t.dataset["rank"] == 4]
    full = (4, "trace_norm", True)
    changed = [(13, "trace_norm", True), (4, "trace_norm", False), (4, "rigid", True), (4, "rigid", False)]
    assert shark == [full, *changed]
    with pytest.raises(UsageError, match="jump"):
        expand(["dataset=mocap_body", "dataset.body=jump"])


def test_record_round_trip(trial: Trial, settings: Settings) -> None:
    outcome, _ = execute(trial, settings)
    assert Outcome.from_json(outcome.to_json()) == outcome
    with pytest.raises(ValueError, match="finite"):
        replace(outcome, metrics={"e_3d": float("nan")})
    for text in ("[]", "{", '{"key": 1}'):
        with pytest.raises(ValueError):
            Outcome.from_json(text)


def test_candidate_scenes_are_the_default_with_one_thing_changed() -> None:
    asked = [
        "experiment=scene_study",
        "dataset=face_yoga",
        "method=edsc",
        "scene=default,offset_y6,native_x3,scale_cut",
    ]
    default, *others = (trial.dataset for trial, _ in expand(asked))
    [(plain, _)] = expand(["dataset=face_yoga", "method=edsc"])
    assert default == plain.dataset
    changes = [{k: v for k, v in scene.items() if v != default[k]} for scene in others]
    assert changes == [{"placement": [0, 6, 0]}, {"motion": "native", "placement": [3, 0, 0]}, {"scale": "cut"}]
