"""Small valid files of every format that is read, and writers that may lie: heads that claim what is not there."""

from __future__ import annotations

import io
import json
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

F, P, J = 7, 6, 4


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


# .npz


def npy(header: str, body: bytes = b"", version: int = 1) -> bytes:
    """An array as in .npz files, with any header."""
    text = header.encode("latin-1", "replace")
    return b"\x93NUMPY" + bytes([version, 0]) + len(text).to_bytes(2 if version == 1 else 4, "little") + text + body


def zipped(members: Iterable[tuple[str, bytes]], compression: int = zipfile.ZIP_STORED) -> bytes:
    """An archive; a name may come twice."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, content in members:
            archive.writestr(zipfile.ZipInfo(name), content, compression)
    return buffer.getvalue()


def npz(arrays: Mapping[str, Any], compressed: bool = False) -> bytes:
    buffer = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(buffer, **arrays)
    return buffer.getvalue()


def people() -> dict[str, Any]:
    """Arrays of two people of one take, as :mod:`nrsfm.datasets.real.two_person` reads them."""
    pair = {name: rng().standard_normal((F, J, 3)) for name in ("lead", "follow")}
    return {**pair, "names": np.array(["hip", "chest", "hand", "head"]), "parents": np.array([-1, 0, 1, 1]), "dt": 0.01}


def trial_arrays() -> dict[str, NDArray[Any]]:
    """Arrays of a finished trial."""
    X = rng().standard_normal((F, 3, P)).astype(np.float32)
    return {
        "tracks": X[:, :2],
        "structure": X,
        "true_structure": X,
        "cameras": np.tile(np.eye(3, dtype=np.float32)[:2], (F, 1, 1)),
        "labels": np.array([0, 0, 0, 1, 1, 1], dtype=np.int32),
        "true_labels": np.array([0, 0, 0, 1, 1, 1], dtype=np.int32),
        "edges": np.array([[0, 1], [1, 2]], dtype=np.int32),
        "frame_e_3d": np.full(F, 0.1, dtype=np.float32),
        "history_objective": np.arange(9, dtype=np.float32),
        "affinity_rows": np.array([0, 1, 2], dtype=np.int32),
        "affinity_columns": np.array([1, 2, 3], dtype=np.int32),
        "affinity_values": np.ones(3, dtype=np.float32),
        "affinity_size": np.array(P, dtype=np.int32),
    }


# MATLAB


def mat4(fields: Mapping[str, NDArray[np.float64]], mopt: int = 0) -> bytes:
    parts = []
    for name, value in fields.items():
        word = name.encode() + b"\0"
        parts.append(struct.pack("<5i", mopt, *value.shape, 0, len(word)) + word + value.tobytes(order="F"))
    return b"".join(parts)


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<2I", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix5(
    name: str, shape: Iterable[int], data: bytes, kind: int = 9, word: int = 6, dims: bytes | None = None
) -> bytes:
    """An array of version 5: class in ``word``, type of the stored numbers in ``kind``."""
    sizes = dims if dims is not None else b"".join(struct.pack("<i", n) for n in shape)
    head = element(6, struct.pack("<2I", word, 0)) + element(5, sizes) + element(1, name.encode())
    return element(14, head + element(kind, data))


def packed5(array: bytes) -> bytes:
    """Compressed, as MATLAB writes it by default."""
    data = zlib.compress(array)
    return struct.pack("<2I", 15, len(data)) + data


def mat5(*arrays: bytes) -> bytes:
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(arrays)


def matrix_of(name: str, value: NDArray[np.float64]) -> bytes:
    return matrix5(name, value.shape, value.tobytes(order="F"))


def mat73(fields: Mapping[str, Any], **storage: Any) -> bytes:
    """A file of version 7.3; ``storage`` goes to h5py's create_dataset."""
    import h5py

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mat"
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, value in fields.items():
                dataset = file.create_dataset(name, data=np.asarray(value).T, **storage)
                dataset.attrs["MATLAB_class"] = np.bytes_("double")
        return with_head73(path.read_bytes())


def with_head73(content: bytes) -> bytes:
    return b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + content[128:]


def numbers() -> dict[str, NDArray[np.float64]]:
    """S (3F, P) and W (2F, P)."""
    return {"S": rng().standard_normal((3 * F, P)), "W": rng().standard_normal((2 * F, P))}


def hopkins() -> dict[str, NDArray[np.float64]]:
    """A scene's x (3, P, F) and s (P, 1)."""
    return {"x": rng().standard_normal((3, P, F)), "s": np.array([1.0, 1, 1, 2, 2, 2])[:, None]}


# C3D


def c3d(labels: Iterable[str] = (), rate: float = 100.0) -> bytes:
    import ezc3d

    names = list(labels) or [f"{who}:m{k}" for who in ("A", "B") for k in range(15)]
    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["RATE"]["value"], point["UNITS"]["value"], point["LABELS"]["value"] = [rate], ["mm"], names
    points = rng().integers(1, 4000, (3, len(names), F)) / 4.0
    file["data"]["points"] = np.concatenate([points, np.ones((1, len(names), F))])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.c3d"
        file.write(str(path))
        return path.read_bytes()


# JSON


def record(**changes: Any) -> bytes:
    """A trial's ``result.json``."""
    fields: dict[str, Any] = {
        "key": "0123456789abcdef",
        "setting": "fedcba9876543210",
        "status": "ok",
        "dataset": "dance_yoga",
        "method": "adaptive",
        "cameras": "known",
        "placement": "paper",
        "motion": "registered",
        "level": 0.0,
        "repeat": 0,
        "stand_in": False,
        "n_bodies": 2,
        "n_points": P,
        "n_frames": F,
        "metrics": {"e_3d": 0.03, "n_wrong": 1.0},
        "seconds": 1.5,
        "peak_mb": 100.0,
        "error": "",
        "finished": "2026-01-02T03:04:05.678+00:00",
        "sweep": "quick",
        "parameters": {"dataset": {"name": "dance_yoga"}, "method": {"name": "adaptive", "alpha": 1.5}, "gaps": {}},
        "environment": {"python": "3.11.7"},
    }
    return json.dumps({name: value for name, value in (fields | changes).items() if value is not ...}).encode()


def opaque5(name: str, kind: str) -> bytes:
    """A MATLAB ``string``, ``table`` or other object of version 5: without a size, with a link to a hidden field."""
    link = np.array([[0xDD000000, 2, 1, 1, 1, 1]], dtype="<u4").T
    words = b"".join(element(1, word.encode()) for word in (name, "MCOS", kind))
    return element(14, element(6, struct.pack("<2I", 17, 0)) + words + matrix5("", link.shape, link.tobytes(), 6, 13))


def hidden5(size: int = 64) -> bytes:
    """The field without a name that holds the objects of a file."""
    return matrix5("", (1, size), bytes(size), 2, 9)
