"""What every method owes: a small scene goes in, and each check holds what comes out against :mod:`nrsfm.methods.base`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from sklearn.base import BaseEstimator, clone

from nrsfm.datasets.generated import procedural
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.metrics import n_wrong
from nrsfm.harness.evaluate.reconstruct import check as check_parts
from nrsfm.methods.base import NO_CAMERAS, Array, Method, MethodError, Reconstruction

CENTRED = 1e-4  # of its size: a frame's mean, where a solver stops


SAME = 1e-8  # of the structure's size: two runs on the same input


CLOSE = 1e-3  # of it: runs on input in another order, which sums, and so iterations stop, otherwise


class Subject:
    """A method under test, its scene, and what it makes of it.

    Parameters
    ----------
    method : Method
    """

    def __init__(self, method: Method) -> None:
        self.method = method

    @cached_property
    def scene(self) -> Scene:
        """A person of 15 points beside a face of 15, over 30 frames."""
        return procedural.load_scene(["person", "face"], 15, 30, 0, name="contract", placement="paper")

    @cached_property
    def found(self) -> Reconstruction:
        return self.run()

    def run(self, **other: Any) -> Reconstruction:
        """The method on the scene, or with other arguments than the scene's."""
        given = self.arguments() | other
        return clone(self.method).reconstruct(**given)

    def arguments(self) -> dict[str, Any]:
        """The scene's arrays, copied, as a trial passes them."""
        scene = self.scene
        cameras = scene.cameras.copy() if self.method.uses_cameras and scene.cameras is not None else NO_CAMERAS
        return {
            "tracks": scene.tracks.copy(),
            "cameras": cameras,
            "n_bodies": scene.n_bodies,
            "edges": scene.edges.copy(),
        }


def check_hyper_parameters(subject: Subject) -> None:
    """The constructor stores what it is given, so that a clone is the same, and reconstruct leaves it."""
    method = subject.method
    before = _plain(method)
    try:
        again = _plain(clone(method))
    except RuntimeError as error:
        raise AssertionError(
            f"{_name(method)}: a constructor keeps what it is given, and this does not: {error}"
        ) from error
    assert again == before, f"{_name(method)}: a clone has {again} and not {before}"
    copy = clone(method)
    copy.set_params(**copy.get_params(deep=False))
    assert _plain(copy) == before, f"{_name(method)}: set_params(**get_params()) changes the hyper-parameters"
    copy.reconstruct(**subject.arguments())
    assert _plain(copy) == before, f"{_name(method)}: reconstruct changes the hyper-parameters {before}"
    assert isinstance(method.version, str) and method.version, f"{_name(method)}: version is no word"


def check_provides(subject: Subject) -> None:
    """It computes what ``provides`` names, and gives nothing that it does not compute."""
    method, found = subject.method, subject.found
    known = {"labels", "structure"}
    assert method.provides and method.provides <= known, (
        f"{_name(method)}: provides is {set(method.provides)}, wanted some of {known}"
    )
    for part in known:
        given = getattr(found, part) is not None
        assert given == (part in method.provides), (
            f"{_name(method)}: provides {'does not name' if given else 'names'} {part}, which is "
            f"{'given' if given else 'absent'}"
        )


def check_shapes(subject: Subject) -> None:
    """Parts have the shapes and kinds of Reconstruction, finite; structure is centred, labels count from 0."""
    name, found, scene = _name(subject.method), subject.found, subject.scene
    _parts(subject, found)
    if found.labels is not None:
        assert np.issubdtype(found.labels.dtype, np.integer), f"{name}: labels are {found.labels.dtype}, not whole"
        assert scene.n_bodies and found.labels.min() >= 0 and found.labels.max() < scene.n_bodies, (
            f"{name}: labels run from {found.labels.min()} to {found.labels.max()} for {scene.n_bodies} bodies"
        )
    if found.structure is not None:
        off = np.abs(found.structure.mean(axis=2)).max() / found.structure.std()
        assert off < CENTRED, f"{name}: structure is off its centre by {off:.1e} of its size"
    if found.affinity is not None:
        A = np.asarray(sp.coo_array(found.affinity).toarray())
        assert A.min() >= 0, f"{name}: the affinity has a negative entry {A.min():.1e}"
        assert np.abs(A - A.T).max() <= SAME * A.max(), f"{name}: the affinity is not symmetric"
    for curve, values in found.history.items():
        assert np.ndim(values) == 1 and np.isfinite(values).all(), f"{name}: history {curve} is no finite curve"


def check_determinism(subject: Subject) -> None:
    """The same input gives the same result, whatever the state of the global random generator."""
    kept = np.random.get_state()  # noqa: NPY002 - what an unseeded method draws from
    try:
        np.random.seed(1)  # noqa: NPY002
        first = subject.run()
        np.random.seed(2)  # noqa: NPY002
        second = subject.run()
    finally:
        np.random.set_state(kept)  # noqa: NPY002
    _same(subject, first, second, SAME, "a second run on the same input")


def check_inputs_stay(subject: Subject) -> None:
    """No array that goes in is written to."""
    given = subject.arguments()
    before = {key: np.copy(value) for key, value in given.items()}
    subject.run(**given)
    for key, value in given.items():
        assert np.array_equal(value, before[key]), f"{_name(subject.method)}: reconstruct writes into its {key}"


def check_order_of_tracks(subject: Subject) -> None:
    """Tracks in another order give the same bodies and points in that order."""
    scene, found = subject.scene, subject.found
    order = np.random.default_rng(0).permutation(scene.n_points)
    edges = np.argsort(order)[scene.edges]  # place i holds track order[i]
    moved = subject.run(tracks=np.ascontiguousarray(scene.tracks[:, :, order]), edges=edges)
    there = Reconstruction(
        labels=None if found.labels is None else found.labels[order],
        structure=None if found.structure is None else found.structure[:, :, order],
    )
    _same(subject, there, moved, CLOSE, "tracks in another order")


def check_cameras(subject: Subject) -> None:
    """With ``uses_cameras`` false the cameras make no difference; with true wrong ones are refused."""
    if not subject.method.uses_cameras:
        _same(
            subject, subject.found, subject.run(cameras=subject.scene.cameras), SAME, "cameras, which it does not use"
        )
        return
    cameras = subject.arguments()["cameras"]
    _refused(subject, "cameras of half the frames", cameras=cameras[::2])
    _refused(subject, "cameras whose rows are not orthonormal", cameras=2 * cameras)


def check_wrong_input(subject: Subject) -> None:
    """Tracks that cannot be worked with end in a MethodError of one line."""
    tracks = subject.scene.tracks
    hole = tracks.copy()
    hole[3, 0, 2] = np.nan
    _refused(subject, "NaN in the tracks", tracks=hole)
    _refused(subject, "tracks of shape (F, 3, P)", tracks=np.concatenate([tracks, tracks[:, :1]], axis=1))
    _refused(subject, "tracks of shape (F, 2)", tracks=tracks[:, :, 0])
    if "labels" in subject.method.provides:
        _refused(subject, "more bodies than tracks", n_bodies=tracks.shape[2] + 1)
        _refused(subject, "0 bodies", n_bodies=0)


def check_unknown_number(subject: Subject) -> None:
    """Without the number of bodies it estimates one, or says in a MethodError that it cannot."""
    found = _result_or_refusal(subject, n_bodies=None)
    if found is not None:
        _parts(subject, found)


def check_gaps(subject: Subject) -> None:
    """Where it knows the word ``visible``, tracks with gaps, NaN, give a whole and finite result or a MethodError."""
    if "visible" not in inspect.signature(subject.method.reconstruct).parameters:
        return
    gappy = subject.scene.with_gaps("random", 0.1)
    visible = gappy.visible
    assert visible is not None
    found = _result_or_refusal(subject, tracks=gappy.tracks.copy(), visible=visible.copy())
    if found is not None:
        _parts(subject, found)


def check_memory(subject: Subject) -> None:
    """The memory that it foresees is a number of bytes that does not shrink with the scene, or None."""
    small, large = (subject.method.memory(30, n, 4 * n) for n in (30, 3000))
    fits = (small is None and large is None) or (small is not None and large is not None and 0 <= small <= large)
    assert fits, f"{_name(subject.method)}: memory foresees {small} bytes for 30 tracks and {large} for 3000"


CHECKS: tuple[Callable[[Subject], None], ...] = (
    check_hyper_parameters,
    check_provides,
    check_shapes,
    check_determinism,
    check_inputs_stay,
    check_order_of_tracks,
    check_cameras,
    check_wrong_input,
    check_unknown_number,
    check_gaps,
    check_memory,
)


def _parts(subject: Subject, found: Reconstruction) -> None:
    try:
        check_parts(found, subject.method.provides, subject.scene.tracks.shape)
    except MethodError as error:
        raise AssertionError(f"{_name(subject.method)}: {error}") from None


def _same(subject: Subject, one: Reconstruction, other: Reconstruction, tolerance: float, what: str) -> None:
    """Raise AssertionError unless two results agree: labels up to their names, structure to a share of its size."""
    name = _name(subject.method)
    if one.labels is not None and other.labels is not None:
        wrong = n_wrong(other.labels, one.labels)
        assert wrong == 0, f"{name}: {what}: {wrong} of {len(one.labels)} tracks change their body; seed what is drawn"
    if one.structure is not None and other.structure is not None:
        off = _distance(one.structure, other.structure)
        assert off <= tolerance, f"{name}: {what}: the structure changes by {off:.1e} of its size"


def _distance(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other) / np.linalg.norm(one))


def _refused(subject: Subject, what: str, **given: Any) -> None:
    """Raise AssertionError unless an input ends in a MethodError of one line."""
    assert _result_or_refusal(subject, **given) is None, f"{_name(subject.method)}: {what} are not refused"


def _result_or_refusal(subject: Subject, **given: Any) -> Reconstruction | None:
    """The result, or None for a MethodError of one line; any other exception is a fault."""
    try:
        return subject.run(**given)
    except MethodError as error:
        said = str(error)
        assert said.strip() and "\n" not in said, (
            f"{_name(subject.method)}: a MethodError says {said!r}, wanted one line"
        )
        return None
    except Exception as error:
        shapes = {key: getattr(value, "shape", value) for key, value in given.items()}
        raise AssertionError(
            f"{_name(subject.method)}: {type(error).__name__} ({error}) on {shapes}, wanted a MethodError"
        ) from error


def _plain(method: BaseEstimator) -> Mapping[str, str]:
    """Hyper-parameters by name, parts by their own, as text that can be compared."""
    return {
        key: type(v).__name__ if isinstance(v, BaseEstimator) else repr(v) for key, v in method.get_params().items()
    }


def _name(method: Method) -> str:
    return type(method).__name__
