"""RigidDepth keeps the contract of every method, and does what it says."""

from __future__ import annotations

import numpy as np

from nrsfm.datasets.cameras import orbit, project
from nrsfm.harness.testing import Check, parametrize_with_checks
from nrsfm.methods.base import Observations
from nrsfm_example.rigid_depth import RigidDepth


@parametrize_with_checks("method=rigid_depth")
def test_contract(check: Check) -> None:
    check()


def test_a_rigid_scene_comes_back() -> None:
    cameras = orbit(40)
    shape = np.random.default_rng(0).standard_normal((1, 3, 12))
    shape -= shape.mean(axis=2, keepdims=True)
    result = RigidDepth().reconstruct(Observations(project(cameras, shape), cameras), 2)
    assert result.structure is not None
    np.testing.assert_allclose(result.structure, np.tile(shape, (40, 1, 1)), atol=1e-9)
