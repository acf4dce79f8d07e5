"""Trust: what a verdict follows from, on generated scenes of which the truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nrsfm.datasets.body import Body
from nrsfm.datasets.cameras import orbit, project
from nrsfm.datasets.composition import compose
from nrsfm.datasets.generated.people import person
from nrsfm.datasets.generated.surfaces import face
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.metric_type import needed
from nrsfm.harness.evaluate.trust import CIRCLE, Trust, camera_turn, trust
from nrsfm.harness.solving.solve import solve
from nrsfm.methods.base import Reconstruction


def test_the_turn_of_an_arc_is_its_length() -> None:
    for degrees in (0.0, 2.0, 20.0, 60.0):
        assert camera_turn(orbit(200, degrees / 199)) == pytest.approx(degrees, rel=0.02, abs=1e-6)
    assert camera_turn(orbit(72, 5.0)) == pytest.approx(CIRCLE)
    back = orbit(72, 5.0)
    back[:, 0] *= -1
    assert camera_turn(back) == pytest.approx(CIRCLE)  # the other sense of a line of sight is the same line


def seen(degrees: float) -> Scene:
    bodies: list[Body] = [person(15, 60, 0), face(15, 60, 0)]
    return compose(bodies, degrees_per_frame=degrees)


def told(scene: Scene, **arguments: object) -> tuple[Trust, float]:
    """Trust in the solution of a scene, and its true error."""
    solution = solve(scene, 2, **arguments)  # type: ignore[arg-type]
    return needed(solution.trust), solution.metrics["e_3d_dai"]


def test_a_camera_that_turns_is_trusted() -> None:
    found, error = told(seen(5.0))
    assert found.verdict == "good" and error < 0.2
    assert error / 4 < found.expected < 4 * error
    assert str(found).startswith("good: expect an error of ")


def test_a_fixed_camera_is_not() -> None:
    found, error = told(seen(0.0))
    assert found.verdict == "not determined" and error > 0.5
    assert "hardly turns (0 degrees)" in str(found) and "deep as it is wide" in str(found)


def test_axes_in_the_wrong_place_are_not() -> None:
    """Images with x for y before known cameras, and blocks of x and y read as rows of one frame."""
    scene = seen(5.0)
    found, error = told(replace(scene, tracks=scene.tracks[:, ::-1].copy()))
    assert found.verdict != "good" and error > 0.5
    blocks = np.concatenate([scene.tracks[:, 0], scene.tracks[:, 1]]).reshape(scene.tracks.shape)
    found, error = told(replace(scene, tracks=blocks, cameras=None), cameras="estimated")
    assert found.verdict == "not determined" and error > 0.5
    assert "contradict each other" in str(found) and "may be mirrored" in str(found)


def test_units_and_axes_do_not_matter(small_scene: Scene, rng: np.random.Generator) -> None:
    S, R = needed(small_scene.structure), needed(small_scene.cameras)
    found = needed(trust(small_scene, Reconstruction(structure=S, cameras=R), known_cameras=False))
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    scene = replace(small_scene, tracks=7 * project(R, S) + 300, structure=None)
    moved = needed(trust(scene, Reconstruction(structure=7 * Q @ S, cameras=R @ Q.T), known_cameras=False))
    assert moved.figures == pytest.approx(found.figures, rel=1e-5, abs=1e-9)
    np.testing.assert_allclose(moved.tracks, 7 * found.tracks, rtol=1e-5)


def test_a_track_that_is_hidden_for_long_is_worse(small_scene: Scene) -> None:
    exact = Reconstruction(structure=small_scene.structure, cameras=small_scene.cameras)
    whole = needed(trust(small_scene, exact, known_cameras=True))
    visible = np.ones((small_scene.n_frames, small_scene.n_points), dtype=bool)
    visible[5:, 7] = visible[12:, whole.tracks.argmax()] = False
    tracks = np.where(visible[:, None], small_scene.tracks, np.nan)
    ids = tuple(f"m{p}" for p in range(small_scene.n_points))
    scene = replace(small_scene, tracks=tracks, visible=visible, track_ids=ids)
    found = needed(trust(scene, exact, known_cameras=True))
    assert found.tracks[7] > 1.5 * whole.tracks[7] and found.expected > whole.expected
    assert found.worst == f"m{whole.tracks.argmax()}"
    assert f"track {found.worst} is determined worst" in str(found)


def test_without_structure_there_is_nothing_to_trust(small_scene: Scene) -> None:
    assert trust(small_scene, Reconstruction(labels=small_scene.labels), known_cameras=True) is None
