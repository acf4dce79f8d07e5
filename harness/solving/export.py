"""What was found as files: arrays, tables, a sequence of point clouds, and a page to look at.

A folder is there whole or not at all. No loop of Python's goes over points.
"""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from nrsfm.harness.evaluate import metrics
from nrsfm.harness.record.environment import environment
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import pack

if TYPE_CHECKING:
    from nrsfm.harness.solving.solution import Solution


MARK = "nrsfm solve"


RESULT, SUMMARY, ARRAYS, VIEW, CLOUDS = "result.json", "summary.txt", "reconstruction.npz", "view.html", "ply"


TABLES = ("structure.csv", "labels.csv", "cameras.csv", "affinity.csv")


OURS = frozenset({RESULT, SUMMARY, ARRAYS, VIEW, CLOUDS, *TABLES})


PAIRS = 2_000_000  # lines of affinity.csv at most


def save(solution: Solution, folder: Path) -> Path:
    """Write a solution into a folder.

    ``reconstruction.npz`` (``structure`` (F, 3, P), ``labels`` (P,), ``cameras`` (F, 2, 3), ``affinity`` (P, P) or,
    where it is sparse, the rows, columns and values of its upper triangle; ``frame_ids``, ``track_ids``, ``bodies``),
    ``structure.csv``, ``labels.csv``, ``cameras.csv``, ``affinity.csv``, ``ply/frame_0000.ply`` and so on,
    ``view.html``, ``summary.txt``, ``result.json``. What the method does not give is left out.

    The folder takes its place once all of it is written; an earlier solution there is replaced.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    UsageError
        If the folder holds anything else than a solution.
    OSError
        If it cannot be written.
    """
    folder = folder.expanduser().resolve()
    check_folder(folder)
    with _whole(folder) as made:
        _arrays(solution, made / ARRAYS)
        if solution.structure is not None:
            _structure(solution, made / TABLES[0])
            _clouds(solution, made / CLOUDS)
        _labels(solution, made / TABLES[1])
        _cameras(solution, made / TABLES[2])
        _affinity(solution, made / TABLES[3])
        (made / VIEW).write_text(page(solution), encoding="utf-8")
        (made / SUMMARY).write_text(f"{solution}\n", encoding="utf-8")
        (made / RESULT).write_text(_record(solution), encoding="utf-8")
    return folder


def check_folder(folder: Path) -> None:
    """Raise UsageError unless a folder can be made, is empty, or holds a solution and nothing else."""
    if not folder.exists():
        place = next(parent for parent in folder.absolute().parents if parent.exists())
        try:
            tempfile.TemporaryDirectory(dir=place).cleanup()
        except OSError as error:
            raise UsageError(f"{place} takes no folder ({error.strerror}); name another with --out") from None
        return
    held = {path.name for path in folder.iterdir()} if folder.is_dir() else {folder.name}
    if not folder.is_dir() or (held and not _is_ours(folder)):
        raise UsageError(f"{folder} is there and no solution of {MARK}; name another folder with --out")
    if foreign := sorted(held - OURS):
        raise UsageError(
            f"{folder} holds {foreign[0]!a}, which would be lost; move it, or name another folder with --out"
        )


def _is_ours(folder: Path) -> bool:
    try:
        told = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(told, dict) and told.get("made_by") == MARK


@contextmanager
def _whole(folder: Path) -> Iterator[Path]:
    """A folder beside another that takes its place in the end, or vanishes."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    _sweep(folder)
    made = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}.{os.getpid()}."))
    before = made.with_name(f"{made.name}.before")
    try:
        yield made
        made.chmod(0o755)
        if folder.is_dir():
            folder.rename(before)
        try:
            made.rename(folder)
        except BaseException:
            if before.is_dir():
                before.rename(folder)
            raise
    finally:
        shutil.rmtree(made, ignore_errors=True)
        shutil.rmtree(before, ignore_errors=True)


def _sweep(folder: Path) -> None:
    """Remove what processes left that were killed while they wrote here."""
    for left in folder.parent.glob(f".{folder.name}.*.*"):
        number = left.name.removeprefix(f".{folder.name}.").partition(".")[0]
        if number.isdigit() and left.is_dir():
            try:
                os.kill(int(number), 0)
            except ProcessLookupError:
                if left.name.endswith(".before") and not folder.exists():
                    left.rename(folder)  # killed between two names
                else:
                    shutil.rmtree(left, ignore_errors=True)
            except (PermissionError, OverflowError):
                continue


def _arrays(solution: Solution, path: Path) -> None:
    parts = {
        "structure": solution.structure,
        "labels": solution.labels,
        "cameras": solution.cameras,
        "affinity": solution.affinity,
        "visible": solution.scene.visible,
        "edges": solution.scene.edges,
        "frame_ids": np.array(solution.frames),
        "track_ids": np.array(solution.ids),
        "bodies": np.array(solution.bodies, dtype=str),
    }
    packed: dict[str, Any] = pack({name: value for name, value in parts.items() if value is not None})
    np.savez_compressed(path, **packed)


def _cells(words: Sequence[str]) -> list[str]:
    """Words as cells of a CSV file, quoted where they must be."""
    cells = []
    for word in words:
        line = io.StringIO()
        csv.writer(line, lineterminator="").writerow([word])
        cells.append(line.getvalue())
    return cells


def _structure(solution: Solution, path: Path) -> None:
    """frame, track, x, y, z, label: one format of all lines of a frame, filled at once."""
    assert solution.structure is not None
    labels = _cells(solution.bodies)
    ends = [""] * len(solution.ids) if solution.labels is None else [labels[k] for k in solution.labels.tolist()]
    rest = [
        f",{track},%.8g,%.8g,%.8g,{end}\n".replace("%.8g", "\0").replace("%", "%%").replace("\0", "%.8g")
        for track, end in zip(_cells(solution.ids), ends, strict=True)
    ]
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write("frame,track,x,y,z,label\n")
        for frame, X in zip(_cells(solution.frames), solution.structure, strict=True):
            mark = frame.replace("%", "%%")
            stream.write("".join([mark + line for line in rest]) % tuple(X.T.ravel().tolist()))


def _clouds(solution: Solution, folder: Path) -> None:
    """A binary .ply for each frame: x, y, z, colour, and the label, -1 for none."""
    from nrsfm.reports.figures.style import COLOURS

    assert solution.structure is not None
    P = len(solution.ids)
    kind = [(axis, "<f4") for axis in "xyz"] + [(c, "u1") for c in ("red", "green", "blue")] + [("label", "<i4")]
    points = np.zeros(P, dtype=kind)
    points["label"] = -1 if solution.labels is None else solution.labels
    palette = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in COLOURS], dtype=np.uint8)
    for axis, channel in zip(("red", "green", "blue"), palette.T, strict=True):
        points[axis] = channel[np.maximum(points["label"], 0) % len(palette)]
    words = {"<f4": "float", "u1": "uchar", "<i4": "int"}
    properties = "".join(f"property {words[code]} {name}\n" for name, code in kind)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {P}\n{properties}end_header\n".encode("ascii")
    digits = max(4, len(str(len(solution.frames) - 1)))
    folder.mkdir()
    for f, X in enumerate(solution.structure):
        for axis, row in zip("xyz", X, strict=True):
            points[axis] = row
        (folder / f"frame_{f:0{digits}d}.ply").write_bytes(head + points.tobytes())


def _labels(solution: Solution, path: Path) -> None:
    if solution.labels is None:
        return
    columns = [solution.ids, [solution.bodies[k] for k in solution.labels.tolist()]]
    truth = solution.scene.labels
    if truth is not None:
        columns.append([solution.scene.bodies[k] if solution.scene.bodies else str(k) for k in truth.tolist()])
    _table(path, ["track", "label", "true_label"][: len(columns)], zip(*columns, strict=True))


def _cameras(solution: Solution, path: Path) -> None:
    if solution.cameras is None:
        return
    rows = ([frame, *row] for frame, row in zip(solution.frames, solution.cameras.reshape(-1, 6).tolist(), strict=True))
    _table(path, ["frame", "xx", "xy", "xz", "yx", "yy", "yz"], rows)


def _affinity(solution: Solution, path: Path) -> None:
    """track_a, track_b, weight of every pair that has one; left out where they are too many for a table."""
    if solution.affinity is None:
        return
    upper = sp.triu(sp.coo_array(solution.affinity), k=1, format="coo")
    if upper.nnz <= PAIRS:
        ids = solution.ids
        a, b = ([ids[k] for k in places.tolist()] for places in (upper.row, upper.col))
        _table(path, ["track_a", "track_b", "weight"], zip(a, b, map("{:.6g}".format, upper.data), strict=True))


def _table(path: Path, header: Sequence[str], rows: Any) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def _record(solution: Solution) -> str:
    convergence = solution.convergence
    told = {
        "made_by": MARK,
        "name": solution.scene.name,
        "data": solution.scene.digest,
        "method": solution.method,
        "parameters": solution.parameters,
        "cameras": solution.cameras_from,
        "facts": [list(fact) for fact in solution.facts()],
        "metrics": solution.metrics,
        "seconds": solution.seconds,
        "iterations": convergence and convergence.iterations,
        "residual": convergence and convergence.residual,
        "tolerance_met": convergence and convergence.met,
        "environment": environment(),
    }
    return json.dumps({name: value for name, value in told.items() if value is not None}, indent=1, default=str) + "\n"


def page(solution: Solution) -> str:
    """The page of a solution, in the axes of the truth where that is known."""
    from nrsfm.harness.evaluate.matching import called
    from nrsfm.reports.page.solution import Shown, view

    scene, S, truth = solution.scene, solution.structure, None
    found = metrics.by_frame(scene, solution.found, known_cameras=solution.known_cameras)
    if S is not None and scene.structure is not None:
        S, truth = found["alignment"] @ S, scene.structure
    wrong = None
    if solution.labels is not None and scene.labels is not None:
        wrong = np.asarray(solution.labels != scene.labels)
    return view(
        Shown(
            title=scene.name,
            facts=solution.facts(),
            ids=solution.ids,
            frames=solution.frames,
            structure=S,
            truth=truth,
            cameras=scene.cameras if truth is not None else solution.cameras,
            labels=solution.labels,
            bodies=[called(body) for body in solution.bodies],
            wrong=wrong,
            edges=scene.edges,
            affinity=solution.affinity,
            history=solution.found.history,
            errors=found.get("frame_e_3d"),
        )
    )
