"""The verb ``data``: list, fetch, check and locate the public data, and write tracks to try."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.public import catalogue as sources
from nrsfm.datasets.public import download
from nrsfm.harness.cli.parser import Parser
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.text import printable

OK, FAILED = 0, 2


def main(argv: Sequence[str]) -> int:
    """Run the verb; exit code 0 fine, 2 a file is missing or wrong.

    Raises
    ------
    DatasetError
        If the folder or a file cannot be used.
    UsageError
        If the catalogue has no file of a name.
    """
    options = command_line().read(argv)
    from nrsfm.harness.config.compose import data_folder

    act = {"list": _list, "get": _get, "verify": _verify, "where": _where, "example": _example}[options.verb]
    try:
        return act(data_folder(), options)
    except KeyboardInterrupt:
        return _say("interrupted; files that were complete are kept, 'nrsfm data get' fetches the rest", FAILED)


def _say(line: str, code: int) -> int:
    print(printable(line), file=sys.stderr)
    return code


def _chosen(names: Sequence[str]) -> list[str]:
    try:
        sources.select(names)
    except DatasetError as error:
        raise UsageError(str(error)) from None
    return list(names)


def _size(n: int) -> str:
    return f"{n / 1e6:.1f} MB"


def _list(folder: Path, options: argparse.Namespace) -> int:
    from rich.console import Console
    from rich.table import Table

    found = sources.status(folder, _chosen(options.names))
    table = Table("file", "state", "size", "terms", "source", box=None, pad_edge=False, header_style="bold")
    table.columns[2].justify = "right"
    for file, state in found:
        table.add_row(file.path, state, _size(file.size), file.terms, file.source)
    console = Console(markup=False, highlight=False, width=None if sys.stdout.isatty() else 200)
    console.print(table)
    n = sum(state == sources.PRESENT for _, state in found)
    console.print(f"\n{n} of {len(found)} in {folder}", soft_wrap=True)
    sys.stdout.flush()
    return OK


def _get(folder: Path, options: argparse.Namespace) -> int:
    names = _chosen(options.names) or [file.path for file in sources.select() if file.group not in sources.ON_REQUEST]
    wanted = [file for file, state in sources.verify(folder, names) if state != sources.PRESENT]
    if not wanted:
        print(f"all {len(sources.select(names))} files are in {folder}")
        return OK
    results = _with_progress(folder, wanted)
    failed: dict[str, list[str]] = {}
    for file, error in results:
        if error is None:
            print(f"{file.path}  {_size(file.size)}  fetched")
        else:
            failed.setdefault(str(error).removeprefix(f"{file.path}: "), []).append(file.path)
    for reason, paths in failed.items():
        more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
        print(f"{paths[0]}{more}: {reason}", file=sys.stderr)
    if not failed:
        return OK
    n = sum(map(len, failed.values()))
    return _say(
        f"{n} of {len(results)} files could not be had; 'nrsfm run experiment=dancers' needs none",
        FAILED,
    )


def _with_progress(folder: Path, wanted: Sequence[sources.File]) -> list[tuple[sources.File, DatasetError | None]]:
    """Fetch, with a bar on a terminal and in silence elsewhere."""
    paths = [file.path for file in wanted]
    if not sys.stdout.isatty():
        return download.get(folder, paths)
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, transient=True) as bars:
        total = bars.add_task("all", total=sum(file.size for file in wanted))
        done: dict[str, int] = {}

        def progress(file: sources.File, n: int) -> None:
            done[file.path] = n
            bars.update(total, completed=sum(done.values()), description=file.path)

        return download.get(folder, paths, progress)


def _verify(folder: Path, options: argparse.Namespace) -> int:
    by_state: dict[str, list[str]] = {sources.PRESENT: [], sources.CHANGED: [], sources.ABSENT: []}
    for file, state in sources.verify(folder, _chosen(options.names)):
        by_state[state].append(file.path)
    right, changed, absent = by_state.values()
    fetch = f"'nrsfm data get {' '.join(dict.fromkeys(path.partition('/')[0] for path in absent))}'"
    for path in right:
        print(f"{path}  ok")
    for path in changed:
        print(f"{path} is not the file of the catalogue; 'nrsfm data get {path}' replaces it", file=sys.stderr)
    if absent and options.names:
        return _say(f"not in {folder}: {', '.join(absent)}; {fetch} fetches them", FAILED)
    if not right and not changed:
        return _say(f"none of the files is in {folder}; {fetch} fetches them", FAILED)
    if absent:
        print(f"{len(absent)} files are not there; {fetch} fetches them")
    return FAILED if changed else OK


def _where(folder: Path, options: argparse.Namespace) -> int:
    named = os.environ.get("NRSFM_DATA", "")
    print(folder)
    if named and Path(named).expanduser().absolute() == folder.absolute():
        print("from NRSFM_DATA" + ("" if folder.is_dir() else "; it is not there yet, 'nrsfm data get' makes it"))
    else:
        print("not from NRSFM_DATA" + (f", which is {named}" if named else ", which is not set"))
    return OK


def _example(folder: Path, options: argparse.Namespace) -> int:
    """Write the tracks of the package's two dancers, with the truth and the cameras, as a file for 'nrsfm solve'."""
    import numpy as np

    from nrsfm.datasets.registry import load_scene
    from nrsfm.harness.config.spans import expand

    path: Path = options.file
    if path.exists():
        raise UsageError(f"{path} is there already; remove it or name another file")
    ((trial, _),) = expand(["dataset=dancers"])
    scene = load_scene(trial.dataset, folder)
    arrays: dict[str, Any] = {name: getattr(scene, name) for name in ("tracks", "structure", "labels", "cameras")}
    try:
        np.savez_compressed(path, **arrays)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from None
    print(f"{path}: {scene.n_points} tracks of two dancers over {scene.n_frames} frames, the cameras and the truth")
    print(f"Try: nrsfm solve {path} --bodies 2")
    return OK


def command_line() -> Parser:
    """The parser, with one for each of its five verbs."""
    parser = Parser(
        "nrsfm data",
        "List, fetch and check the public data, and say where it is kept.",
        """\
nrsfm data list  # every file of the catalogue: state, size, terms, source
nrsfm data get  # fetch what the paper's tables need and is absent
nrsfm data get hopkins155  # the 155 motion segmentation scenes (27 MB)
nrsfm data get drink shark  # the files of two sequences
nrsfm data verify  # check the files against their SHA-256
NRSFM_DATA=~/nrsfm nrsfm data where
nrsfm data example  # tracks of two dancers in dancers.npz, to try 'nrsfm solve' on""",
        "exit codes: 0 fine, 2 a file is missing or wrong, 3 wrong usage\n"
        "The folder is NRSFM_DATA where that is set. 'nrsfm run experiment=dancers' needs no files.",
    )
    verbs = parser.add_subparsers(dest="verb", metavar="{list,get,verify,where,example}", required=True)
    names = "a group (mocap, hopkins155, c3d), a file (mocap/drink.mat, drink) or a sequence (shark); {} by default"
    for verb, text in (
        ("list", "every file: state, size, terms, source"),
        (
            "get",
            "fetch the files that are absent or damaged; a file is put in its place only once its SHA-256 is right",
        ),
        ("verify", "check the SHA-256 of what is there; files that are named must be there"),
    ):
        default = f"all but {', '.join(sorted(sources.ON_REQUEST))}" if verb == "get" else "all"
        parsed = verbs.add_parser(verb, help=text, description=text)
        parsed.add_words("names", _files, nargs="*", metavar="NAME", help=names.format(default))
    text = "print the data folder, and whether it comes from NRSFM_DATA"
    verbs.add_parser("where", help=text, description=text)
    text = "write tracks of two dancers, with the truth, to try 'nrsfm solve' on"
    example = verbs.add_parser("example", help=text, description=text)
    example.add_argument(
        "file", nargs="?", type=Path, default=Path("dancers.npz"), metavar="FILE", help="dancers.npz by default"
    )
    return parser


def _files() -> Mapping[str, str]:
    return {word: file.source for file in sources.select() for word in sorted(file.words)}
