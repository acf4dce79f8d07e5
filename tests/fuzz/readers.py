"""Every reader of files from strangers, with valid files of its formats and the checks of what it reads."""

from __future__ import annotations

import io
import json
import warnings
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from nrsfm.datasets.cameras import orbit
from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers import c3dfile
from nrsfm.datasets.readers.c3dfile import read_c3d
from nrsfm.datasets.readers.guarded import Damaged
from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.datasets.readers.npzfile import read_npz
from nrsfm.datasets.real import hopkins
from nrsfm.datasets.real.take import load_c3d
from nrsfm.datasets.real.tracks import load_tracks
from nrsfm.datasets.registry import load_scene
from nrsfm.datasets.scene import Scene
from nrsfm.harness.config.spans import expand
from nrsfm.harness.gate.baseline import Baseline
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import read_arrays, read_record
from nrsfm.harness.sweep.work import Work
from nrsfm.harness.trial.journal import entries
from nrsfm.harness.trial.progress import steps
from nrsfm.methods.base import MethodError
from nrsfm.methods.registry import build_method
from tests.fuzz import files

REFUSALS = (DatasetError, UsageError, MethodError)
BASELINE = Path(__file__).parents[2] / "reports/baselines/quick.json"
Wrap = Callable[[bytes], bytes]


@dataclass(frozen=True)
class Reader:
    """A reader of one kind of file.

    Parameters
    ----------
    place : str
        Path of its file below a folder.
    seeds : callable
        Valid files.
    read : callable
        Reads the file in the folder and checks what comes back; raises one of :data:`REFUSALS`.
    wraps : tuple of callable
        Ways to make a file of bytes: as they are, compressed, or as a member of an archive, so that damage reaches
        what stands behind a checksum.
    apart : bool
        It reads in another process, which is slow and cannot be watched from this one.
    named : bool
        A complaint names the file.
    """

    place: str
    seeds: Callable[[], list[bytes]]
    read: Callable[[Path], object]
    wraps: tuple[Wrap, ...] = (bytes,)
    apart: bool = False
    named: bool = True


def refused(reader: Reader, folder: Path, content: bytes) -> bool:
    """Whether a file is refused, in one line that names it. What was read is checked.

    Any other exception goes through, and so does a warning.
    """
    path = folder / reader.place
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    try:
        with warnings.catch_warnings(action="error"):
            reader.read(folder)
    except REFUSALS as error:
        text = str(error)
        assert text.isprintable() and len(text) < 1500 + len(str(path)), text
        assert path.name in text or not reader.named, text
        return True
    return False


def _is_scene(scene: Scene) -> None:
    """Scenes check themselves when they are made; what they do not check."""
    F, _, P = scene.tracks.shape
    seen = np.ones((F, P), bool) if scene.visible is None else scene.visible
    assert np.isfinite(scene.tracks.transpose(0, 2, 1)[seen]).all()
    if scene.structure is not None:
        assert np.isfinite(scene.structure.transpose(0, 2, 1)[seen]).all()
    if scene.labels is not None:
        assert set(scene.labels.tolist()) == set(range(len(scene.bodies)))
    assert not scene.edges.size or (scene.edges.min() >= 0 and scene.edges.max() < P)


def _npz(folder: Path) -> None:
    for name, value in read_npz(folder / "a.npz").items():
        assert isinstance(name, str) and not value.dtype.hasobject


def _mat(folder: Path, names: Sequence[str] = ("S", "W")) -> None:
    for value in read_mat(folder / "a.mat", names).values():
        assert value.dtype == np.float64


def _c3d_head(folder: Path) -> None:
    try:
        frames, points, _ = c3dfile._header(folder / "a.c3d")
    except Damaged as error:
        raise DatasetError(f"{folder / 'a.c3d'}: {error}") from None
    assert 0 < frames * points <= c3dfile.LARGEST


def _c3d(folder: Path) -> None:
    markers = read_c3d(folder / "a.c3d")
    assert markers.points.shape[1:] == (3, len(markers.labels)) and not np.isinf(markers.points).any()


def _record(folder: Path) -> None:
    outcome = read_record(folder / "0123456789abcdef")
    if outcome is not None:
        assert outcome.key == "0123456789abcdef" and outcome.identity and outcome.gaps is not None
        assert json.loads(outcome.to_json())


def _arrays(folder: Path) -> None:
    read_arrays(folder / "arrays.npz")


def _journal(folder: Path) -> None:
    for entry, offset in entries(folder / "trials.jsonl"):
        assert isinstance(entry.key, str) and offset > 0


def _running(folder: Path) -> None:
    for key, step in steps(folder, "x"):
        assert key and step.words


def _member(content: bytes) -> bytes:
    return files.zipped([("a.npy", content)])


def _deflated_member(content: bytes) -> bytes:
    return files.zipped([("tracks.npy", content)], zipfile.ZIP_DEFLATED)


def _packed5(content: bytes) -> bytes:
    return files.mat5(files.packed5(content))


def _baseline() -> bytes:
    """The committed one, two rows of it."""
    baseline = json.loads(BASELINE.read_text())
    return json.dumps(baseline | {"rows": baseline["rows"][:2]}).encode()


def _npys() -> list[bytes]:
    return [
        files.npy("{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }\n", bytes(48)),
        files.npy("{'descr': '<U4', 'fortran_order': True, 'shape': (2,), }\n", bytes(32)),
        files.npy("{'descr': [('a', '<i4'), ('b', '|O')], 'fortran_order': False, 'shape': (1L,), }\n", bytes(12)),
    ]


def _mat5s() -> list[bytes]:
    arrays = [files.matrix_of(name, value) for name, value in files.numbers().items()]
    return [files.mat5(*arrays), files.mat5(*map(files.packed5, arrays)), files.mat4(files.numbers())]


def _mat73s() -> list[bytes]:
    return [files.mat73(files.numbers()), files.mat73(files.numbers(), chunks=(2, 4), compression="gzip")]


def _seeded(arrays: Callable[[], Any]) -> Callable[[], list[bytes]]:
    return lambda: [files.npz(arrays()), files.npz(arrays(), compressed=True)]


def _hopkins() -> list[bytes]:
    arrays = [files.matrix_of(name, value) for name, value in files.hopkins().items()]
    threes = files.matrix5("x", (3, files.P, files.F), files.hopkins()["x"].tobytes(order="F"))
    return [files.mat5(threes, arrays[1]), files.mat5(files.packed5(threes), files.packed5(arrays[1]))]


def _work() -> list[bytes]:
    trial = {name: {"name": "a", "source": "known", "level": 0.0, "repeat": 0} for name in ("dataset", "method")}
    trial |= {"cameras": {"source": "known"}, "noise": {"level": 0.0, "repeat": 0}}
    settings = {"output": "/nowhere", "data": "/nowhere", "tracking_uri": "", "seconds": 10.0}
    head = {"path": "a.work", "until": 1.0, "host": "host", "pid": 1}
    job = {"trial": trial, "settings": settings, "identity": {"key": "a"}, "old": ""}
    return [json.dumps(head | {"jobs": [job]}).encode()]


def _override(folder: Path) -> None:
    for trial, settings in expand([(folder / "a.txt").read_text(encoding="latin-1")]):
        assert trial.setting and settings.output


def _method(folder: Path) -> None:
    """A configuration that somebody else wrote."""
    for trial, _ in expand([f"hydra.searchpath=[file://{folder}]", "method=strange"]):
        build_method({k: v for k, v in trial.method.items() if k != "name"})


def _own(suffix: str) -> Callable[[Path], None]:
    return lambda folder: _is_scene(load_tracks(folder / f"a{suffix}"))


def _own_arrays() -> dict[str, NDArray[Any]]:
    """Arrays of a user's own tracks, with cameras, structure and labels."""
    S = files.rng().standard_normal((files.F, 3, files.P))
    R = np.tile(np.eye(3)[:2], (files.F, 1, 1))
    return {"tracks": R @ S, "structure": S, "cameras": R, "labels": np.arange(files.P) % 2}


def _own_mats() -> list[bytes]:
    stacked = {"W": _own_arrays()["tracks"].reshape(-1, files.P), "s": np.arange(files.P, dtype=float)[:, None] % 2}
    arrays = [files.matrix_of(name, value) for name, value in stacked.items()]
    return [files.mat5(*arrays), files.mat5(*map(files.packed5, arrays)), files.mat4(stacked)]


def _csvs() -> list[bytes]:
    rows = [f"{f},t{p},{f + p / 8},{f * p / 4},{p % 2},{int(f != p)}" for f in range(4) for p in range(3)]
    long = "frame,track,x,y,label,visible\n" + "\n".join(rows)
    wide = "frame,x_a,y_a,x_b,y_b\n" + "\n".join(f"{f},{f},{2 * f},,".replace(",,", f",{f / 2},1e1") for f in range(4))
    return [long.encode(), wide.encode(), b"a.x,a.y,b.x,b.y\n1,2,3,4\n2,3,,\n1,2,3,4\n4,5,6,7\n"]


def _turning() -> NDArray[np.float64]:
    """Smooth tracks (F, P, 2), in pixels."""
    S = 90 * files.rng().standard_normal((3, files.P))
    return np.asarray((orbit(files.F) @ S).transpose(0, 2, 1) + 300)


def _npy(array: NDArray[Any]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def _trackers() -> dict[str, NDArray[Any]]:
    """What CoTracker writes."""
    W = _turning()
    return {"pred_tracks": W[None], "pred_visibility": np.ones((1, *W.shape[:2], 1), dtype=bool)}


def _sleaps() -> list[bytes]:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.create_dataset("tracks", data=_turning().transpose(2, 1, 0)[None], compression="gzip")
        file["node_names"] = [f"n{k}" for k in range(files.P)]
    return [buffer.getvalue()]


def _tables() -> list[bytes]:
    boxes = [f"{f + 1},{p + 1},{9 * f + p},{f},8,9,1,-1,-1,-1" for f in range(4) for p in range(3)]
    heads = ("scorer,me,me,me,me", "bodyparts,a,a,b,b", "coords,x,y,x,y")
    pairs = [f"{f};{f},5;{2 * f};1,25;{f}" for f in range(4)]
    return [
        "\n".join(lines).encode()
        for lines in (boxes, [*heads, *(f"{f},1,{f},3,4" for f in range(4))], ["frame;a_x;a_y;b_x;b_y", *pairs])
    ]


def _poses() -> list[bytes]:
    held = [
        {"image_id": f, "idx": k, "keypoints": [f + k + 1, 2, 1, 3 * f + 1, 4, 0.5]} for f in range(4) for k in range(2)
    ]
    return [json.dumps(content).encode() for content in (held, {"images": [], "annotations": held})]


SCENE = hopkins.SCENES[0]
TWO_PERSON: dict[str, Any] = {
    "source": "two_person",
    "name": "a",
    "take": "a",
    "range": None,
    "stride": None,
    "frames": 400,
}
TWO_PERSON |= {"degrees_per_frame": 5.0}

READERS: dict[str, Reader] = {
    "npz": Reader("a.npz", _seeded(files.people), _npz),
    "npy": Reader("a.npz", _npys, _npz, (_member, _deflated_member)),
    "mat": Reader("a.mat", _mat5s, _mat, apart=True),
    "mat5_compressed": Reader(
        "a.mat", lambda: [files.matrix_of("S", files.numbers()["S"])], lambda f: _mat(f, ["S"]), (_packed5,), apart=True
    ),
    "mat73": Reader("a.mat", _mat73s, _mat, apart=True),
    "c3d_head": Reader("a.c3d", lambda: [files.c3d()], _c3d_head),
    "c3d": Reader("a.c3d", lambda: [files.c3d()], _c3d, apart=True),
    "take": Reader("a.c3d", lambda: [files.c3d()], lambda f: _is_scene(load_c3d(f / "a.c3d", name="a")), apart=True),
    "two_person": Reader("two_person/a.npz", _seeded(files.people), lambda f: _is_scene(load_scene(TWO_PERSON, f))),
    "hopkins": Reader(
        f"hopkins155/{SCENE}_truth.mat", _hopkins, lambda f: _is_scene(hopkins.load_scene(f, SCENE)), apart=True
    ),
    "baseline": Reader("a.json", lambda: [_baseline()], lambda f: Baseline.read(f / "a.json")),
    "record": Reader("0123456789abcdef/result.json", lambda: [files.record()], _record),
    "arrays": Reader("arrays.npz", _seeded(files.trial_arrays), _arrays),
    "journal": Reader(
        "trials.jsonl",
        lambda: [b'{"key": "a", "title": "dance ours", "status": "ok", "ran": true}\n' * 2],
        _journal,
    ),
    "running": Reader(
        "sweeps/x/running/a.json",
        lambda: [b'{"title": "a", "iteration": 3, "iterations": 9, "residuals": {"shape": 0.1}}'],
        _running,
    ),
    "tracks_npz": Reader("a.npz", _seeded(_own_arrays), _own(".npz")),
    "tracks_mat": Reader("a.mat", _own_mats, _own(".mat"), apart=True),
    "tracks_csv": Reader("a.csv", _csvs, _own(".csv")),
    "tracks_npy": Reader("a.npy", lambda: [_npy(_turning())], _own(".npy")),
    "tracks_trackers": Reader("a.npz", _seeded(_trackers), _own(".npz")),
    "tracks_h5": Reader("a.h5", _sleaps, _own(".h5"), apart=True),
    "tracks_txt": Reader("a.txt", _tables, _own(".txt")),
    "tracks_json": Reader("a.json", _poses, _own(".json")),
    "tracks_c3d": Reader("a.c3d", lambda: [files.c3d()], _own(".c3d"), apart=True),
    "override": Reader(
        "a.txt",
        lambda: [
            b"dataset=dance_yoga,face_yoga",
            b"noise.level=range(0,0.1,0.02)",
            b"+dataset.placement=[1,2,{a: b}]",
            b"method.name=${oc.env:HOME}",
            b"~method.clusterer",
        ],
        _override,
        named=False,
    ),
    "method_yaml": Reader(
        "method/strange.yaml",
        lambda: [b"defaults: [edsc, _self_]\nname: strange\nclusterer: {power: 3, dimension: null}\n"],
        _method,
        named=False,
    ),
    "work": Reader("a.work", _work, lambda f: Work.read(f / "a.work")),
}


@cache
def seeds(name: str) -> tuple[bytes, ...]:
    """Valid files of a reader, or what its wraps make files of."""
    return tuple(READERS[name].seeds())
