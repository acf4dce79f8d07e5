"""Two people in one take, as arrays, and archives from strangers."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from nrsfm.datasets import registry
from nrsfm.datasets.body import Array, centre, spread, upright
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.public import catalogue as sources
from nrsfm.datasets.readers.npzfile import read_npz
from nrsfm.datasets.real import two_person
from nrsfm.datasets.real.two_person import FIRST, SHIPPED
from nrsfm.harness.evaluate.metric_type import needed
from tests.datasets.real import make_dancers

F, J = 20, 6
NAMES = ["hip", "chest", "rHand", "rThumb1", "rIndex1", "head"]
PARENTS = [-1, 0, 1, 2, 2, 1]
BODY = [0, 1, 2, 5]  # without the fingers
SETTINGS: dict[str, Any] = {
    "source": "two_person",
    "name": "pair",
    "take": "pair",
    "range": None,
    "stride": None,
    "frames": 400,
}
SETTINGS |= {"degrees_per_frame": 5.0}


def people() -> dict[str, Array]:
    rng = np.random.default_rng(0)
    return {name: rng.standard_normal((F, J, 3)) for name in ("lead", "follow")}


def write(folder: Path, **changes: Any) -> Path:
    arrays = {**people(), "names": np.array(NAMES), "parents": np.array(PARENTS), "dt": np.array(1 / 120), **changes}
    path = folder / "two_person/pair.npz"
    path.parent.mkdir(exist_ok=True)
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path


def test_layout(tmp_path: Path) -> None:
    path = write(tmp_path)
    scene = registry.load_scene(SETTINGS, tmp_path)
    S = np.concatenate([X[FIRST:, BODY].transpose(0, 2, 1) for X in people().values()], axis=2)
    S = centre(upright(S, "y"))
    assert scene.structure is not None and scene.labels is not None
    np.testing.assert_allclose(scene.structure, S / spread(S), atol=1e-12)
    assert scene.bodies == ("lead", "follow") and scene.name == "pair"
    np.testing.assert_array_equal(scene.labels, np.repeat([0, 1], 4))
    np.testing.assert_array_equal(scene.edges, [[0, 1], [1, 2], [1, 3], [4, 5], [5, 6], [5, 7]])
    assert registry.digest(SETTINGS, tmp_path) == sources.sha256(path)
    thinned = registry.load_scene(SETTINGS | {"frames": 10}, tmp_path)
    assert thinned.n_frames == 9 and thinned.structure is not None
    np.testing.assert_allclose(
        thinned.structure * spread(S[::2]), scene.structure[::2] * spread(S), atol=1e-12
    )  # placement as captured: thinning moves nobody


def test_absent(tmp_path: Path) -> None:
    for call in (registry.load_scene, registry.digest):
        with pytest.raises(MissingData, match="CMU subjects 60 and 61"):
            call(SETTINGS, tmp_path, True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"names": None}, "field names is missing"),
        ({"x" * 5000: np.zeros((0, 0, 0))}, "'x{40}' has shape"),
        ({"dt": np.array(0.0)}, "field dt"),
        ({"dt": np.array("x")}, "field dt"),
        ({"parents": np.array([-1, 0, 1, 2, 2, 6])}, "field parents"),
        ({"parents": np.zeros(3, dtype=int)}, "field parents"),
        ({"lead": np.zeros((F, J + 1, 3))}, "'lead' has shape"),
        ({"lead": np.zeros((F, J, 3), dtype=int)}, "'lead' has shape"),
        ({"lead": np.zeros((F + 1, J, 3))}, "wanted one shape"),
        ({"lead": None, "follow": None}, "it holds no person"),
        ({"lead": np.zeros((4, J, 3)), "follow": np.zeros((4, J, 3))}, "wanted one shape"),
        ({"lead": np.full((F, J, 3), np.nan, dtype="f2")}, "pair.npz: 'lead' holds NaN"),
        ({"names": np.array([{}] * J, dtype=object)}, "names.npy' holds objects"),
    ],
)
def test_broken(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    write(tmp_path, **changes)
    with pytest.raises(DatasetError, match=message) as caught:
        registry.load_scene(SETTINGS, tmp_path)
    assert "\n" not in str(caught.value)


# Archives


def member(header: str, body: bytes = b"") -> bytes:
    text = header.encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + body


def archive(path: Path, content: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as stream:
        stream.writestr("a.npy", content)
    return path


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (member("{'descr': '<f8', 'fortran_order': False, 'shape': (99999999, 99999), }\n"), "claims"),
        (member("{'descr': '<f8', 'fortran_order': False, 'shape': (100,), }\n", bytes(8)), "as many numbers"),
        (member("{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }\n", bytes(90)), "as many numbers"),
        (member("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }\n", bytes(90)), "claims"),
        (member("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }\n"), "holds objects"),
        (member("nonsense\n"), "not a readable"),
        (b"\x93NUMPY\x09\x00", "unknown version"),
        (
            member("{'descr': '<f8', 'fortran_order': False, 'shape': (9000000,), }\n", bytes(72_000_000)),
            "claims 69 MiB",
        ),
        (member("{'descr': '<f8', 'fortran_order': False, 'shape': (0, " + "9" * 40 + "), }\n"), "not a readable"),
        (member("{'descr': '<f8', 'fortran_order': False, 'shape': (1L,), }\n", bytes(8)), "not a readable"),
        (member("{'descr': " + "(" * 900 + "\n"), "not a readable"),
        (member("{'descr': " + "-" * 9000 + "1}\n"), "not a readable"),
        (member("{'descr': 'f1\x00', 'fortran_order': False, 'shape': (1,), }\n"), "not a readable"),
        (b"text", "not a readable"),
        (b"", "not a readable"),
    ],
)
def test_hostile_archives(tmp_path: Path, content: bytes, message: str) -> None:
    path = archive(tmp_path / "a.npz", content)
    with pytest.raises(DatasetError, match=message) as caught:
        read_npz(path)
    assert str(path) in str(caught.value) and str(caught.value).isprintable()


def test_many_small_claims_are_one_large_one(tmp_path: Path) -> None:
    part = member("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000,), }\n", bytes(8_000_000))
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as stream:
        for k in range(9):
            stream.writestr(f"{k}.npy", part)
    with pytest.raises(DatasetError, match=r"'8\.npy' claims 8 MiB"):
        read_npz(tmp_path / "a.npz")


@pytest.mark.parametrize("compression", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_archives_that_numpy_does_not_write(tmp_path: Path, compression: int) -> None:
    content = member("{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }\n", bytes(8))
    with zipfile.ZipFile(tmp_path / "a.npz", "w", compression) as stream:
        stream.writestr("a.npy", content)
    with pytest.raises(DatasetError, match="compressed in another way"):
        read_npz(tmp_path / "a.npz")
    with pytest.warns(UserWarning, match="Duplicate"), zipfile.ZipFile(tmp_path / "a.npz", "w") as stream:
        stream.writestr("a.npy", content)
        stream.writestr("a.npy", content)
    with pytest.raises(DatasetError, match="is stored twice"):
        read_npz(tmp_path / "a.npz")


def test_archives_cut_anywhere(tmp_path: Path) -> None:
    path = write(tmp_path)
    whole = path.read_bytes()
    for kept in range(0, len(whole) - 1, 251):
        path.write_bytes(whole[:kept])
        with pytest.raises(DatasetError, match="not a readable"):
            read_npz(path)


def test_arrays_come_back(tmp_path: Path) -> None:
    arrays: dict[str, Any] = {
        "f": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "s": np.array(3),
        "t": np.array(["ab", "c"]),
    }
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    (tmp_path / "a.npz").write_bytes(buffer.getvalue())
    read = read_npz(tmp_path / "a.npz")
    for name, value in arrays.items():
        np.testing.assert_array_equal(read[name], value)
    with pytest.raises(MissingData):
        read_npz(tmp_path / "b.npz")


@pytest.mark.data
@pytest.mark.parametrize("take", ["salsa_01", "salsa_02", "salsa_03", "salsa_04"])
def test_real_takes(data_folder: Path, take: str) -> None:
    """Bones keep their length, and the two dancers stay within reach of each other."""
    scene = registry.load_scene(SETTINGS | {"take": take}, data_folder)
    assert 200 < scene.n_frames <= 400 and scene.n_points == 54 and scene.structure is not None
    i, j = scene.edges.T
    lengths = np.linalg.norm(scene.structure[:, :, i] - scene.structure[:, :, j], axis=1)
    assert lengths.std(axis=0).max() < 1e-5 and len(scene.edges) == 52
    hips = np.linalg.norm(scene.structure[:, :, 0] - scene.structure[:, :, 27], axis=1)
    body = scene.structure[:, :, :27].std(axis=2).mean()
    assert 0 < hips.min() < 3 * body and hips.mean() < 6 * body
    assert scene.structure[:, 2, 4].mean() > scene.structure[:, 2, 20].mean()  # heads are above feet


class TestShipped:
    """The two dancers that come with the package."""

    SETTINGS: ClassVar[dict[str, Any]] = SETTINGS | {"name": "dancers", "take": SHIPPED}

    def test_they_need_no_data_folder(self, tmp_path: Path) -> None:
        scene = registry.load_scene(self.SETTINGS, tmp_path / "nowhere")
        assert scene.bodies == ("lead60", "follow61")
        assert (scene.n_frames, scene.n_points, len(needed(scene.edges))) == (309, 54, 52)

    def test_their_bones_keep_their_length(self, tmp_path: Path) -> None:
        scene = registry.load_scene(self.SETTINGS, tmp_path)
        start, end = needed(scene.edges).T
        lengths = np.linalg.norm(needed(scene.structure)[..., start] - needed(scene.structure)[..., end], axis=1)
        assert (lengths.std(axis=0) < 0.03 * lengths.max()).all()

    def test_they_are_small_and_their_terms_stand_beside(self) -> None:
        file = two_person.path(Path("nowhere"), SHIPPED)
        assert file.stat().st_size <= 400_000
        assert "mocap.cs.cmu.edu" in file.with_suffix(".txt").read_text(encoding="utf-8")

    @pytest.mark.data
    def test_they_are_what_their_maker_makes_of_the_take(self, data_folder: Path, tmp_path: Path) -> None:
        make_dancers.main(two_person.path(data_folder, "salsa_04"), tmp_path / "made.npz")
        made, shipped = (read_npz(file) for file in (tmp_path / "made.npz", two_person.path(data_folder, SHIPPED)))
        assert made.keys() == shipped.keys()
        for name, values in made.items():
            np.testing.assert_array_equal(values, shipped[name])
