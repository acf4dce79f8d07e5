"""The contract of a method: checks of its results on a small scene against :mod:`nrsfm.methods.base`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from sklearn.base import BaseEstimator, clone

from nrsfm.datasets.generated import procedural
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.errors import n_wrong
from nrsfm.harness.evaluate.reconstruct import check as check_parts
from nrsfm.methods.base import Method, MethodError, Observations, Reconstruction

#: Largest mean of a frame of the structure, relative to the structure's size.
CENTRED = 1e-4
#: Largest difference of two runs on the same input, relative to the structure's size.
SAME = 1e-8
#: The same for tracks in another order: sums round differently, so a solver may stop elsewhere.
CLOSE = 1e-3


class Subject:
    """A method under test, its scene, and its reconstruction of the scene."""

    def __init__(self, method: Method) -> None:
        self.method = method

    @property
    def name(self) -> str:
        return type(self.method).__name__

    @cached_property
    def scene(self) -> Scene:
        """A person of 15 points beside a face of 15, over 30 frames."""
        return procedural.load_scene(["person", "face"], 15, 30, 0, name="contract", placement="paper")

    @cached_property
    def reconstruction(self) -> Reconstruction:
        return self.run()

    def observations(self, **changes: Any) -> Observations:
        """Copies of the scene's arrays, as a trial passes them, but for some changes."""
        scene = self.scene
        cameras = scene.cameras.copy() if self.method.uses_cameras and scene.cameras is not None else None
        return replace(Observations(scene.tracks.copy(), cameras, edges=scene.edges.copy()), **changes)

    def run(self, n_bodies: int | None = 2, **changes: Any) -> Reconstruction:
        """The result of a clone of the method on :meth:`observations`."""
        result: Reconstruction = clone(self.method).reconstruct(self.observations(**changes), n_bodies)
        return result


def check_hyper_parameters(subject: Subject) -> None:
    """The constructor stores its arguments unchanged, so that a clone is the same, and reconstruct keeps them."""
    method = subject.method
    before = _plain(method)
    try:
        again = _plain(clone(method))
    except RuntimeError as error:
        raise AssertionError(
            f"{subject.name}: the constructor changes an argument; store it as it is: {error}"
        ) from error
    assert again == before, f"{subject.name}: a clone has {again} and not {before}"
    copy = clone(method)
    copy.set_params(**copy.get_params(deep=False))
    assert _plain(copy) == before, f"{subject.name}: set_params(**get_params()) changes the hyper-parameters"
    copy.reconstruct(subject.observations(), 2)
    assert _plain(copy) == before, f"{subject.name}: reconstruct changes the hyper-parameters {before}"
    assert isinstance(method.version, str) and method.version, (
        f"{subject.name}: version is {method.version!r}, wanted text"
    )


def check_provides(subject: Subject) -> None:
    """Exactly the parts that ``provides`` names are in the result."""
    method = subject.method
    known = {"labels", "structure"}
    assert method.provides and method.provides <= known, (
        f"{subject.name}: provides is {set(method.provides)}, wanted some of {known}"
    )
    for part in known:
        present = getattr(subject.reconstruction, part) is not None
        assert present == (part in method.provides), (
            f"{subject.name}: provides {'does not name' if present else 'names'} {part}, which is "
            f"{'present' if present else 'absent'}"
        )


def check_shapes(subject: Subject) -> None:
    """Parts have the shapes and types of Reconstruction, and are finite; structure is centred, labels count from 0."""
    name, result, n_bodies = subject.name, subject.reconstruction, subject.scene.n_bodies
    _parts(subject, result)
    if result.labels is not None:
        assert np.issubdtype(result.labels.dtype, np.integer), f"{name}: labels are {result.labels.dtype}, not integer"
        assert n_bodies and result.labels.min() >= 0 and result.labels.max() < n_bodies, (
            f"{name}: labels run from {result.labels.min()} to {result.labels.max()} for {n_bodies} bodies"
        )
    if result.structure is not None:
        off = np.abs(result.structure.mean(axis=2)).max() / result.structure.std()
        assert off < CENTRED, f"{name}: structure is off its centre by {off:.1e} of its size"
    if result.affinity is not None:
        A = np.asarray(sp.coo_array(result.affinity).toarray())
        assert A.min() >= 0, f"{name}: the affinity has a negative entry {A.min():.1e}"
        assert np.abs(A - A.T).max() <= SAME * A.max(), f"{name}: the affinity is not symmetric"
    for curve, values in result.history.items():
        assert np.ndim(values) == 1 and np.isfinite(values).all(), f"{name}: history {curve} is no finite curve"


def check_determinism(subject: Subject) -> None:
    """The same input gives the same result, whatever the state of the global random generator."""
    before = np.random.get_state()  # noqa: NPY002 - the generator of an unseeded method
    try:
        np.random.seed(1)  # noqa: NPY002
        first = subject.run()
        np.random.seed(2)  # noqa: NPY002
        second = subject.run()
    finally:
        np.random.set_state(before)  # noqa: NPY002
    _same(subject, first, second, SAME, "a second run on the same input")


def check_inputs_stay(subject: Subject) -> None:
    """No input array is written to."""
    observations = subject.observations()
    arrays = {name: value for name, value in vars(observations).items() if isinstance(value, np.ndarray)}
    before = {name: value.copy() for name, value in arrays.items()}
    clone(subject.method).reconstruct(observations, 2)
    for name, value in arrays.items():
        assert np.array_equal(value, before[name]), f"{subject.name}: reconstruct writes into its {name}"


def check_order_of_tracks(subject: Subject) -> None:
    """Tracks in another order give the same bodies and points in that order."""
    scene, result = subject.scene, subject.reconstruction
    order = np.random.default_rng(0).permutation(scene.n_points)
    edges = np.argsort(order)[scene.edges]  # place i holds track order[i]
    moved = subject.run(tracks=np.ascontiguousarray(scene.tracks[:, :, order]), edges=edges)
    expected = Reconstruction(
        labels=None if result.labels is None else result.labels[order],
        structure=None if result.structure is None else result.structure[:, :, order],
    )
    _same(subject, expected, moved, CLOSE, "tracks in another order")


def check_cameras(subject: Subject) -> None:
    """With ``uses_cameras`` false the cameras make no difference; with true their absence is refused."""
    if subject.method.uses_cameras:
        _refused(subject, "tracks without cameras", cameras=None)
    else:
        seen = subject.run(cameras=subject.scene.cameras)
        _same(subject, subject.reconstruction, seen, SAME, "cameras, which it does not use")


def check_wrong_numbers(subject: Subject) -> None:
    """A number of bodies that the tracks cannot have ends in a MethodError of one line."""
    if "labels" in subject.method.provides:
        _refused(subject, "more bodies than tracks", n_bodies=subject.scene.n_points + 1)
        _refused(subject, "0 bodies", n_bodies=0)


def check_unknown_number(subject: Subject) -> None:
    """Without the number of bodies the method estimates one, or raises a MethodError."""
    result = _result_or_refusal(subject, n_bodies=None)
    if result is not None:
        _parts(subject, result)


def check_gaps(subject: Subject) -> None:
    """With ``handles_gaps``, tracks with gaps, NaN, give a whole and finite result or a MethodError."""
    if subject.method.handles_gaps:
        scene = subject.scene.with_gaps("random", 0.1)
        result = _result_or_refusal(subject, tracks=scene.tracks, visible=scene.visible)
        if result is not None:
            _parts(subject, result)


def check_memory(subject: Subject) -> None:
    """The forecast of memory is a number of bytes that does not shrink with the scene, or None."""
    small, large = (subject.method.memory(30, n, 4 * n) for n in (30, 3000))
    fits = (small is None and large is None) or (small is not None and large is not None and 0 <= small <= large)
    assert fits, f"{subject.name}: memory forecasts {small} bytes for 30 tracks and {large} for 3000"


CHECKS: tuple[Callable[[Subject], None], ...] = (
    check_hyper_parameters,
    check_provides,
    check_shapes,
    check_determinism,
    check_inputs_stay,
    check_order_of_tracks,
    check_cameras,
    check_wrong_numbers,
    check_unknown_number,
    check_gaps,
    check_memory,
)


def _parts(subject: Subject, result: Reconstruction) -> None:
    try:
        check_parts(result, subject.method.provides, subject.scene.tracks)
    except MethodError as error:
        raise AssertionError(f"{subject.name}: {error}") from None


def _same(subject: Subject, one: Reconstruction, other: Reconstruction, tolerance: float, what: str) -> None:
    """Raise AssertionError unless two results agree: labels up to their names, structure to a share of its size."""
    name = subject.name
    if one.labels is not None and other.labels is not None:
        wrong = n_wrong(other.labels, one.labels)
        assert wrong == 0, f"{name}: {what}: {wrong} of {len(one.labels)} tracks change their body; seed what is drawn"
    if one.structure is not None and other.structure is not None:
        off = np.linalg.norm(one.structure - other.structure) / np.linalg.norm(one.structure)
        assert off <= tolerance, f"{name}: {what}: the structure changes by {off:.1e} of its size"


def _refused(subject: Subject, what: str, **changes: Any) -> None:
    """Raise AssertionError unless an input ends in a MethodError of one line."""
    assert _result_or_refusal(subject, **changes) is None, f"{subject.name}: {what} are not refused"


def _result_or_refusal(subject: Subject, **changes: Any) -> Reconstruction | None:
    """The result, or None for a MethodError of one line; AssertionError for any other exception."""
    try:
        return subject.run(**changes)
    except MethodError as error:
        message = str(error)
        assert message.strip() and "\n" not in message, (
            f"{subject.name}: a MethodError has the message {message!r}, wanted one line"
        )
        return None
    except Exception as error:
        shapes = {key: getattr(value, "shape", value) for key, value in changes.items()}
        raise AssertionError(
            f"{subject.name}: {type(error).__name__} ({error}) on {shapes}, wanted a MethodError"
        ) from error


def _plain(method: BaseEstimator) -> Mapping[str, str]:
    """Hyper-parameters and those of parts, as text that can be compared."""
    return {
        key: type(v).__name__ if isinstance(v, BaseEstimator) else repr(v) for key, v in method.get_params().items()
    }
