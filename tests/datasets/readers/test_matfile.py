"""MATLAB files that no MATLAB wrote: their claims are checked before memory is taken."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.public.catalogue import sha256
from nrsfm.datasets.readers import guarded, guarded_child, matfile
from nrsfm.datasets.readers.limits import RATIO, SMALL, allowance
from nrsfm.datasets.readers.matfile import read_mat
from nrsfm.datasets.real.tracks import load_tracks
from tests.fuzz import files

ONE = files.matrix5("S", (1, 1), np.ones(1).tobytes())


def complaint(path: Path, content: bytes, name: str = "S") -> str:
    path.write_bytes(content)
    with pytest.raises(DatasetError) as caught:
        read_mat(path, [name])
    text = str(caught.value)
    assert text.isprintable() and str(path) in text and len(text) < 1000 + len(str(path))
    return text


def test_what_a_file_may_ask_for(tmp_path: Path) -> None:
    """A little whatever its size, a multiple of its size, and never more than 2 GiB."""
    path = tmp_path / "a"
    with path.open("wb") as stream:
        for size, most in ((10, SMALL), (10**7, RATIO * 10**7), (10**9, 2**31)):
            stream.truncate(size)
            assert allowance(path) == most


def test_a_small_file_that_inflates_without_end(tmp_path: Path) -> None:
    """70 MB of zeros in 70 kB, as one field and as many; fields that are not wanted are not inflated."""
    bomb = files.packed5(files.matrix5("S", (9_000_000, 1), bytes(72_000_000)))
    assert len(bomb) < 80_000
    assert "claims 69 MiB" in complaint(tmp_path / "a.mat", files.mat5(bomb))
    (tmp_path / "a.mat").write_bytes(files.mat5(bomb, ONE.replace(b"S", b"T")))
    assert read_mat(tmp_path / "a.mat", ["T"])["T"] == 1


def test_a_stream_that_goes_on_behind_its_array(tmp_path: Path) -> None:
    """The head claims one number and 200 MB follow."""
    data = zlib.compress(ONE + bytes(200_000_000), 9)
    content = files.mat5(struct.pack("<2I", 15, len(data)) + data)
    assert "Did not fully consume compressed contents" in complaint(tmp_path / "a.mat", content)


def test_a_field_that_is_there_twice(tmp_path: Path) -> None:
    assert "field S is stored twice" in complaint(tmp_path / "a.mat", files.mat5(ONE, ONE))
    assert "field S is stored twice" in complaint(tmp_path / "a.mat", files.mat4({"S": np.ones((1, 2))}) * 2)


@pytest.mark.parametrize("shape", [(0, 2**31 - 1, 2**31 - 1, 2**31 - 1), (2**31 - 1,) * 8, (-1, 2)])
def test_impossible_shapes(tmp_path: Path, shape: tuple[int, ...]) -> None:
    complaint(tmp_path / "a.mat", files.mat5(files.matrix5("S", shape, b"")))


def test_a_message_stays_a_line_whatever_the_names(tmp_path: Path) -> None:
    long = files.matrix5("\x1b[2J\n" * 9999, (1, 1), np.ones(1).tobytes())
    assert "field S is missing (the file holds \\x1b[2J" in complaint(tmp_path / "a.mat", files.mat5(long))


def test_odd_numbers_are_read_in_silence(tmp_path: Path) -> None:
    """A signalling NaN in single precision."""
    (tmp_path / "a.mat").write_bytes(files.mat5(files.matrix5("S", (1, 1), b"\x01\x00\xa0\x7f", kind=7)))
    assert np.isnan(read_mat(tmp_path / "a.mat", ["S"])["S"])


def test_only_files_of_the_catalogue_are_read_in_this_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(files.mat5(ONE))
    kinds = []

    def read(kind: str, path: Path, *arguments: Any) -> dict[str, Any]:
        kinds.append(kind)
        return guarded_child.mat(str(path), *arguments[1:])

    monkeypatch.setattr(matfile, "read_guarded", read)
    assert read_mat(path, ["S"])["S"] == 1
    assert kinds == ["mat"]
    monkeypatch.setattr(matfile, "_known_digests", lambda: {sha256(path)})
    assert read_mat(path, ["S"])["S"] == 1
    assert kinds == ["mat"]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("version", [4, 5])
def test_numbers_of_either_byte_order(tmp_path: Path, version: int, order: str) -> None:
    """The layout of MathWorks, "MAT-File Format", written by hand: scipy writes the order of this machine alone."""
    W = np.arange(12.0).reshape(4, 3)
    numbers = W.astype(f"{order}f8").tobytes(order="F")

    def element(kind: int, content: bytes) -> bytes:
        return struct.pack(f"{order}2I", kind, len(content)) + content + bytes(-len(content) % 8)

    if version == 4:
        content = struct.pack(f"{order}5i", 1000 * (order == ">"), *W.shape, 0, 2) + b"W\0" + numbers
    else:
        parts = [
            (6, struct.pack(f"{order}2I", 6, 0)),
            (5, struct.pack(f"{order}2i", *W.shape)),
            (1, b"W"),
            (9, numbers),
        ]
        head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(f"{order}H", 0x100) + (b"IM" if order == "<" else b"MI")
        content = head + element(14, b"".join(element(*part) for part in parts))
    (tmp_path / "a.mat").write_bytes(content)
    assert np.array_equal(read_mat(tmp_path / "a.mat", ["W"])["W"], W)


def test_archives_of_either_byte_order(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    arrays: dict[str, Any] = {"tracks": rng.normal(size=(12, 2, 8)), "labels": np.repeat([1, 2], 4)}
    arrays["visible"] = (rng.random((12, 8)) > 0.1).astype(float)
    arrays["cameras"] = np.linalg.qr(rng.normal(size=(12, 3, 3)))[0][:, :2]
    scenes = []
    for order in "<>":
        np.savez(
            tmp_path / "a.npz",
            **{name: value.astype(value.dtype.newbyteorder(order)) for name, value in arrays.items()},
        )
        scenes.append(load_tracks(tmp_path / "a.npz"))
    for name in ("tracks", "labels", "visible", "cameras"):
        first, other = (getattr(scene, name) for scene in scenes)
        assert other.dtype.isnative and np.array_equal(first, other, equal_nan=True), name


@pytest.mark.parametrize("head", [b"# Created by Octave 8.4.0\n# name: S\n# type: scalar\n1\n", b"Octave-1-L\0"])
def test_formats_of_octave_are_refused_by_name(tmp_path: Path, head: bytes) -> None:
    assert "format of Octave's own; save it there with: save -v7 a.mat" in complaint(tmp_path / "a.mat", head)


# Version 7.3


@pytest.mark.parametrize("block", [0, 512])
def test_hdf5_that_h5py_wrote(tmp_path: Path, block: int) -> None:
    """Without MATLAB's head its arrays are as h5py has them; behind one they are as MATLAB would read them."""
    W = np.arange(12).reshape(4, 3)
    for kind in ("f8", ">f4", "i2"):
        with h5py.File(tmp_path / "a.mat", "w", userblock_size=block) as file:
            file["W"] = (W.T if block else W).astype(kind)
        assert np.array_equal(read_mat(tmp_path / "a.mat", ["W"])["W"], W), kind


@pytest.mark.parametrize("kind", ["string", "table", "datetime"])
def test_newer_classes_are_refused_by_name(tmp_path: Path, kind: str) -> None:
    with h5py.File(tmp_path / "b.mat", "w", userblock_size=512) as file:
        file.create_dataset("S", data=np.ones((1, 6), np.uint32)).attrs["MATLAB_class"] = np.bytes_(kind)
    content = files.with_head73((tmp_path / "b.mat").read_bytes())
    assert f"field S is of type {kind}, wanted numbers" in complaint(tmp_path / "a.mat", content)


def hdf5(path: Path, **storage: object) -> bytes:
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("S", **storage).attrs["MATLAB_class"] = np.bytes_("double")
    return files.with_head73(path.read_bytes())


@pytest.mark.parametrize(
    ("storage", "message"),
    [
        ({"shape": (3000, 3000), "dtype": "f8", "chunks": (10, 10), "compression": "gzip"}, "claims 69 MiB"),
        ({"shape": (3000, 3000), "dtype": "i1"}, "claims 69 MiB"),
        ({"shape": (4, 4), "maxshape": (None, None), "dtype": "f8", "chunks": (4000, 4000)}, "claims 122 MiB"),
        ({"shape": (4, 4), "dtype": "f8", "chunks": (4, 4), "compression": "lzf"}, "compressed in another way"),
        ({"shape": (4, 4), "dtype": "i4", "chunks": (4, 4), "scaleoffset": 0}, "compressed in another way"),
        ({"data": [[b"a"]]}, "wanted numbers"),
        ({"shape": (2,), "dtype": h5py.ref_dtype}, "wanted numbers"),
        ({"shape": (2,), "dtype": h5py.vlen_dtype(float)}, "wanted numbers"),
        ({"shape": (2,), "dtype": [("re", "f8"), ("im", "f8")]}, "wanted numbers"),
    ],
)
def test_version_73(tmp_path: Path, storage: dict[str, object], message: str) -> None:
    assert message in complaint(tmp_path / "a.mat", hdf5(tmp_path / "b.mat", **storage))


def test_virtual_datasets_lead_nowhere(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["secret"] = np.ones(4)
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "secret", (4,))
    with h5py.File(tmp_path / "b.mat", "w", userblock_size=512) as file:
        file.create_virtual_dataset("S", layout).attrs["MATLAB_class"] = np.bytes_("double")
    content = files.with_head73((tmp_path / "b.mat").read_bytes())
    assert "not stored in the file itself" in complaint(tmp_path / "a.mat", content)


def test_a_list_that_leads_back_to_itself_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One byte of the heap of names makes HDF5 take memory without end; its process has an end."""
    content = bytearray(files.mat73(files.numbers()))
    place = content.index(b"S".ljust(8, b"\0") + b"W".ljust(8, b"\0"), 512) + 16
    assert content[place] == 1, "behind the names the list of free blocks ends"
    content[place] = 24
    monkeypatch.setattr(guarded, "BASE_BYTES", 2**28)
    assert "Link iteration failed" in complaint(tmp_path / "a.mat", bytes(content))


def test_tracks_of_no_points(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(files.mat4({"W": np.zeros((14, 0))}))
    with pytest.raises(DatasetError, match=r"a\.mat"):
        load_tracks(path)


@pytest.mark.filterwarnings("error")
def test_labels_in_half_precision(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    tracks = files.rng().standard_normal((files.F, 2, files.P))
    path.write_bytes(files.npz({"tracks": tracks, "labels": np.array([0, 0, 0, 1, 1, 1], dtype="f2")}))
    assert load_tracks(path).bodies == ("0", "1")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("field", ["tracks", "structure"])
def test_numbers_whose_squares_are_none(tmp_path: Path, field: str) -> None:
    S = files.rng().standard_normal((files.F, 3, files.P))
    arrays = {"tracks": S[:, :2].copy(), "structure": S}
    arrays[field][0, 0, 0] = 1e308
    (tmp_path / "a.npz").write_bytes(files.npz(arrays))
    with pytest.raises(DatasetError, match=r"a\.npz: it holds numbers above 1e\+100"):
        load_tracks(tmp_path / "a.npz")
