"""Every method reports its stages while it works."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from nrsfm.datasets.scene import Scene
from nrsfm.harness.config.spans import expand
from nrsfm.methods.base import Observations, stage
from nrsfm.methods.registry import build_method


class Listener:
    """Records the stages, and the stages in which iterations were reported."""

    def __init__(self) -> None:
        self.stages: list[str] = []
        self.counted: set[str] = set()

    def stage(self, name: str) -> None:
        if [name] != self.stages[-1:]:
            self.stages.append(name)

    def __call__(self, iteration: int, iterations: int, residuals: Mapping[str, float]) -> None:
        assert 1 <= iteration <= iterations
        assert residuals and all(np.isfinite(value) for value in residuals.values())
        self.counted.add(self.stages[-1])


WAYS = {
    "adaptive": (["weights", "structure and code", "clustering"], {"weights", "structure and code"}),
    "ours": (["structure and code", "clustering"], {"structure and code"}),
    "bmm": (["structure"], {"structure"}),
    "smooth_bmm": (["structure"], {"structure"}),
    "r_bmm": (["structure"], {"structure"}),
    "organic": (["structure"], {"structure"}),
    "pta": (["structure"], set()),
    "csf1": (["structure"], {"structure"}),
    "csf2": (["structure"], {"structure"}),
    "pnd": (["structure"], {"structure"}),
    "ssc2d": (["clustering"], set()),
    "edsc": (["clustering"], set()),
    "omp2d": (["clustering"], set()),
    "lrr2d": (["clustering"], set()),
    "ensc2d": (["clustering"], set()),
    "lsr2d": (["clustering"], set()),
    "neighbours2d": (["clustering"], set()),
    "bmm_ssc3d": (["structure", "clustering"], {"structure"}),
    "ssc2d_bmm": (["clustering", "structure"], {"structure"}),
}


@pytest.mark.parametrize("name", WAYS)
def test_every_method_reports_its_stages(name: str, small_scene: Scene) -> None:
    ((trial, _),) = expand([f"method={name}"])
    method = build_method({k: v for k, v in trial.method.items() if k != "name"})
    listener = Listener()
    n_bodies = 1 if method.provides == {"structure"} else 2
    method.reconstruct(Observations(small_scene.tracks, small_scene.cameras, progress=listener), n_bodies)
    assert (listener.stages, listener.counted) == WAYS[name]


@pytest.mark.parametrize("name", ["adaptive", "ours", "ssc2d"])
def test_gaps_are_a_stage(name: str, small_scene: Scene) -> None:
    ((trial, _),) = expand([f"method={name}"])
    method = build_method({k: v for k, v in trial.method.items() if k != "name"})
    scene = small_scene.with_gaps(kind="random", share=0.1, repeat=0)
    listener = Listener()
    method.reconstruct(Observations(scene.tracks, scene.cameras, scene.visible, progress=listener), 2)
    assert listener.stages[0] == "gaps"


def test_a_plain_function_is_called_for_iterations_alone() -> None:
    stage(lambda iteration, iterations, residuals: None, "structure")
    stage(None, "structure")
