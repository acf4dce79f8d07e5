"""Files made from what their formats have, put together wrongly: fields, sizes and types that do not fit each other."""

from __future__ import annotations

import json
import math
import zipfile
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.fuzz import files

SIZES = st.one_of(st.integers(0, 8), st.sampled_from([-1, 255, 2**16, 10**7, 2**31 - 1, 2**31, 2**63, 10**30]))
NUMBERS = st.one_of(
    st.integers(-3, 9).map(float), st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 1e155])
)
ODD_TEXT = st.one_of(
    st.text(max_size=12),
    st.sampled_from(
        [
            "",
            "../../x",
            "<script>alert(1)</script>",
            "\x1b[2J",
            "a\nb",
            "\0",
            "nan",
            "1e999",
            "=1+1",
            "\u202e",
            "x" * 5000,
        ]
    ),
)
DTYPES = st.sampled_from(
    ["f8", "f4", "f2", ">f8", "i8", "i1", "u8", "?", "c16", "U3", "S3", "M8[s]", "m8[D]", "V4", "i4,f8"]
)


def _names(valid: dict[str, Any]) -> st.SearchStrategy[str]:
    return st.one_of(st.sampled_from(list(valid)), st.sampled_from(["W", "S", "s", "Rs", "R", "visible"]), ODD_TEXT)


def _array() -> st.SearchStrategy[Any]:
    shapes = st.one_of(
        hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=8),
        st.sampled_from([(7, 2, 6), (14, 6), (7, 3, 6), (7, 4, 3), (6,), (6, 1), (7, 6), (2, 2)]),
    )
    return st.tuples(DTYPES, shapes, st.randoms(use_true_random=False)).map(lambda t: _filled(*t))


def _filled(dtype: str, shape: tuple[int, ...], chance: Any) -> Any:
    values = np.array([chance.choice([0.0, 1.0, 2.0, -1.0, 0.5]) for _ in range(math.prod(shape))])
    array = values.reshape(shape).astype(np.float64)
    if chance.random() < 0.3 and array.size:
        array.flat[chance.randrange(array.size)] = chance.choice([np.nan, np.inf, 1e308, -1e308, 1e155])
    with np.errstate(all="ignore"):
        kind = np.dtype(dtype)
        return array.astype(kind) if kind.kind in "fiubcUS" else np.zeros(shape, kind)


def _npz(valid: dict[str, Any]) -> st.SearchStrategy[bytes]:
    """A valid file some of whose arrays are others."""
    changed = st.dictionaries(_names(valid), st.one_of(st.none(), _array()), min_size=1, max_size=3)
    return changed.map(lambda new: _members({**{k: np.asarray(v) for k, v in valid.items()}, **new}))


def _members(arrays: dict[str, Any]) -> bytes:
    kept = {
        k.replace("\0", "_").replace("/", "_"): v for k, v in arrays.items() if v is not None and k not in ("file",)
    }
    parts = []
    for name, value in kept.items():
        descr = np.lib.format.dtype_to_descr(value.dtype)
        head = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {value.shape!r}, }}\n"
        parts.append((f"{name}.npy", files.npy(head, value.tobytes())))
    return files.zipped(parts)


@st.composite
def npy(draw: st.DrawFn) -> bytes:
    """A header that claims anything, before bytes that may deflate to next to nothing."""
    shape = draw(st.lists(SIZES, max_size=5))
    descr = draw(
        st.one_of(st.sampled_from(["'<f8'", "'|O'", "'<U0'", "'V0'", "'<M8[s]'", "[('a', '<f8')]"]), ODD_TEXT.map(repr))
    )
    sizes = "".join(f"{n}, " for n in shape)
    head = f"{{'descr': {descr}, 'fortran_order': {draw(st.booleans())}, 'shape': ({sizes}), }}\n"
    head = draw(st.sampled_from([head, head, head, head.replace("}", ""), "(" * 500 + head, head * 20, "[" * 5000]))
    body = bytes(draw(st.sampled_from([0, 8, 100, 10**6])))
    how = draw(st.sampled_from([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA]))
    return files.zipped([("a.npy", files.npy(head, body, draw(st.sampled_from([1, 2, 3]))))], how)


@st.composite
def mat(draw: st.DrawFn, names: tuple[str, ...] = ("S", "W")) -> bytes:
    """Arrays of version 5, or 4, whose heads claim anything."""
    arrays = []
    for name in draw(st.lists(st.one_of(st.sampled_from(names), ODD_TEXT.filter(str.isascii)), min_size=1, max_size=4)):
        shape = draw(
            st.one_of(st.just([2, 3]), st.lists(SIZES.map(lambda n: min(n, 2**31 - 1)), min_size=1, max_size=5))
        )
        data = np.array(draw(st.lists(NUMBERS, min_size=6, max_size=6))).tobytes() + bytes(
            draw(st.sampled_from([0, 0, 8, 10**6]))
        )
        kind, word = (
            draw(st.sampled_from([9, 9, 7, 1, 2, 14, 99])),
            draw(st.sampled_from([6, 6, 7, 8, 1, 2, 5, 0x806, 255])),
        )
        array = files.matrix5(name, shape, data, kind, word)
        arrays.append(draw(st.sampled_from([array, array[:-8], files.packed5(array)])))
    return files.mat5(*arrays)


#: JSON values of any kind.
JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(-(10**40), 10**40), NUMBERS, ODD_TEXT),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(ODD_TEXT, inner, max_size=3)),
    max_leaves=6,
)


def changed_json(valid: bytes) -> st.SearchStrategy[bytes]:
    """A valid object with other values in some of its fields, at any depth."""
    return st.tuples(st.randoms(use_true_random=False), JSON).map(
        lambda t: json.dumps(_changed(json.loads(valid), *t)).encode()
    )


def _changed(value: Any, chance: Any, other: Any) -> Any:
    if isinstance(value, dict) and value and chance.random() < 0.9:
        name = chance.choice(list(value))
        return {**value, name: _changed(value[name], chance, other)}
    if isinstance(value, list) and value and chance.random() < 0.8:
        at = chance.randrange(len(value))
        return [*value[:at], _changed(value[at], chance, other), *value[at + 1 :]]
    return other


@st.composite
def csv(draw: st.DrawFn) -> bytes:
    """Tables long and wide, of cells and headers that need not fit."""
    header = draw(
        st.one_of(
            st.sampled_from(
                ["frame,track,x,y", "frame,track,x,y,label,visible", "x_a,y_a", "frame,a.x,a.y,b.x,b.y", ""]
            ),
            st.lists(
                st.one_of(st.sampled_from(["frame", "track", "x", "y", "x_a", "y_a", "label"]), ODD_TEXT), max_size=6
            ).map(",".join),
        )
    )
    width = header.count(",") + 1
    cell = st.one_of(
        st.integers(-2, 3).map(str),
        st.sampled_from(["", "nan", "inf", "1e308", "-1e308", "1_0", "٣", '"', "0x1"]),
        ODD_TEXT,
    )
    row = st.one_of(st.lists(cell, min_size=width, max_size=width), st.lists(cell, max_size=7))
    rows = draw(st.lists(row, max_size=12))
    text = "\n".join([header, *(",".join(row) for row in rows)])
    return draw(st.sampled_from(["", "\ufeff"])).encode() + text.encode("utf-8", "surrogatepass")


#: Files of a reader that are made, not damaged.
MADE: dict[str, st.SearchStrategy[bytes]] = {
    "npz": _npz(files.people()),
    "npy": npy(),
    "two_person": _npz(files.people()),
    "arrays": _npz(files.trial_arrays()),
    "tracks_npz": _npz({"tracks": np.zeros((7, 2, 6)), "labels": np.arange(6) % 2}),
    "mat": mat(),
    "mat5_compressed": mat(),
    "tracks_mat": mat(("W", "s", "visible")),
    "hopkins": mat(("x", "s")),
    "record": changed_json(files.record()),
    "tracks_csv": csv(),
}
