"""Tracks in text tables: each layout is known by the first lines, or by the columns that the user names."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from pathlib import Path

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.readers.longtable import Long
from nrsfm.datasets.readers.textfile import Table, opened
from nrsfm.datasets.readers.trackfile import RECOGNISED, Asked, TrackFile, unused
from nrsfm.datasets.readers.widetable import Point, Wide

NEEDED, KNOWN = ("frame", "track", "x", "y"), ("label", "visible", "confidence")
FRAME = ("frame", "frame_idx", "")  # pandas leaves the name of the index empty
PAIR = re.compile(r"(?P<axis>[xyXY])[_.](?P<name>.+)|(?P<first>.+)[_.](?P<last>[xyXY])")
SURE = re.compile(r"(?P<name>.+)[_.](?:confidence|conf|likelihood|score|visible|visibility)")
CONFIDENCE = 0.5  # from which a position counts as observed
LIKELIHOOD = 0.6  # the same for DeepLabCut, whose "pcutoff" it is

HEADERS = (
    "wanted the header frame,track,x,y[,label][,visible] with a line for each observation, or x_A,y_A,x_B,y_B,..., "
    "A_x,A_y,... or A.x,A.y,... with a line for each frame; columns of other names: --columns frame=A,track=B,x=C,y=D"
)

Plan = Long | Wide


def read_csv(path: Path, asked: Asked = RECOGNISED) -> TrackFile:
    """Read tracks from a text table in one of :data:`LAYOUTS`.

    An observation that is missing has no line, or empty or ``nan`` coordinates, or ``visible`` 0.

    Raises
    ------
    DatasetError
        If the file is no such text or too large, is of no known layout, or a line does not fit.
    """
    with opened(path) as table:
        _check(table, asked)
        plan = next((plan for layout in LAYOUTS if (plan := layout(table, asked))), None)
        if plan is None:
            held = ", ".join(ascii(word[:40])[1:-1] for word in table.head[0][:10])
            raise DatasetError(f"{path}: its header holds {held or 'names no track'}; {HEADERS}")
        return plan.read(table)


def _check(table: Table, asked: Asked) -> None:
    """Raise DatasetError unless the columns that the user names are there."""
    header = table.head[0]
    for role, name in asked.columns.items():
        if header.count(name) != 1:
            words = ", ".join(ascii(word[:40])[1:-1] for word in header[:10])
            raise DatasetError(f"{table.path}: {role}={name[:40]!a} names no column or two; it holds {words}")


def _long(table: Table, asked: Asked) -> Plan | None:
    """frame, track, x, y, and where they are known label, visible and confidence."""
    header = table.head[0]
    names = {role: asked.columns.get(role, role) for role in (*NEEDED, *KNOWN)}
    if not {names[role] for role in NEEDED} <= set(header):
        return None
    columns = {role: header.index(name) for role, name in names.items() if name in header}
    if len(set(header)) < len(header):
        raise DatasetError(f"{table.path}: its header holds a name twice; {HEADERS}")
    least, notes = _least(asked, CONFIDENCE if "confidence" in columns else 0.0)
    return Long(columns, least, notes=(*notes, *_others(header, columns.values())))


def _deeplabcut(table: Table, asked: Asked) -> Plan | None:
    """DeepLabCut: lines scorer, individuals (of several animals), bodyparts and coords above the numbers."""
    rows = {row[0]: row for row in table.head if row}
    if not {"scorer", "bodyparts", "coords"} <= set(rows):
        return None
    coords, parts = rows["coords"], rows["bodyparts"]
    animals = rows.get("individuals", [""] * len(parts))
    if not len(coords) == len(parts) == len(animals):
        raise DatasetError(f"{table.path}: the lines of its header differ in length; write it again")
    place = {(animals[k], parts[k], word): k for k, word in enumerate(coords)}
    points = tuple(
        Point(part, k, place[animal, part, "y"], place.get((animal, part, "likelihood"), -1), animal)
        for (animal, part, word), k in place.items()
        if word == "x" and (animal, part, "y") in place
    )
    frame = next(k for k, word in enumerate(coords) if word in ("x", "y", "likelihood", "visible")) - 1
    weighed = any(point.confidence >= 0 for point in points)
    least, notes = _least(asked, LIKELIHOOD if weighed else 0.0)
    read = "read as DeepLabCut writes it"
    return Wide(points, frame, least=least, skip=table.head.index(coords) + 1, notes=(read, *notes), image=True)


def _wide(table: Table, asked: Asked) -> Plan | None:
    """x_A, y_A, ..., A_x, A_y, ... or A.x, A.y, ...; in SLEAP's tables a line is of a ``track`` in a ``frame_idx``."""
    header = table.head[0]
    pairs: dict[str, dict[str, int]] = {}
    for k, word in enumerate(header):
        if match := PAIR.fullmatch(word):
            name, axis = match["name"] or match["first"], (match["axis"] or match["last"]).lower()
            if axis in pairs.setdefault(name, {}):
                raise DatasetError(f"{table.path}: its header names a track twice, {name[:40]!a}; {HEADERS}")
            pairs[name][axis] = k
    if not pairs:
        return None
    if single := next((name for name, pair in pairs.items() if len(pair) == 1), None):
        raise DatasetError(f"{table.path}: its header holds one of x and y for {single[:40]!a}; {HEADERS}")
    sure = {match["name"]: k for k, word in enumerate(header) if (match := SURE.fullmatch(word))}
    sleap = {"track", "frame_idx"} <= set(header)
    points = tuple(Point(name, pair["x"], pair["y"], sure.get(name, -1)) for name, pair in pairs.items())
    framed = [name for name in ([asked.columns["frame"]] if "frame" in asked.columns else FRAME) if name in header]
    frame = header.index(framed[0]) if framed else -1
    body = header.index("track") if sleap else -1
    weighed = any(point.confidence >= 0 for point in points) and not sleap  # SLEAP leaves out what it does not see
    least, notes = _least(asked, CONFIDENCE if weighed else 0.0)
    used = {frame, body, *(k for point in points for k in (point.x, point.y, point.confidence))}
    notes = (*(["read as SLEAP writes it"] if sleap else []), *notes, *_others(header, used))
    return Wide(points, frame, body, least, notes=notes, image=sleap)


def _mot(table: Table, asked: Asked) -> Plan | None:
    """MOTChallenge, no header: frame, id, left, top, width and height of a box, flag (0: ignore), and more."""
    numbers = [word.lstrip("-").replace(".", "", 1).isdigit() for row in table.head for word in row]
    if len(table.head[0]) not in (9, 10) or not all(numbers):
        return None
    names = ("frame", "track", "x", "y", "width", "height", "flag" if asked.confidence is None else "confidence")
    notes = ("read as MOTChallenge writes it: a track is the centre of a box",)
    columns = {name: k for k, name in enumerate(names)}
    return Long(columns, asked.confidence or 0.0, skip=0, notes=notes, image=True)


#: Which of the layouts a table is in: the first that knows it.
LAYOUTS: tuple[Callable[[Table, Asked], Plan | None], ...] = (_deeplabcut, _long, _wide, _mot)


def _least(asked: Asked, usual: float) -> tuple[float, tuple[str, ...]]:
    """The confidence that is wanted, and a note on it where one is known."""
    least = usual if asked.confidence is None else asked.confidence
    return least, (f"confidence below {least:g} counts as not observed (--confidence)",) if least > 0 else ()


def _others(header: list[str], used: Collection[int]) -> tuple[str, ...]:
    return unused("column", [word for k, word in enumerate(header) if k not in used])
