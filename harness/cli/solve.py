"""The verb ``solve``: reconstruct the tracks of a file. Uses no tracker and no trial folder."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nrsfm.harness.cli.parser import Parser, group_choices
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.trial import AUTO

if TYPE_CHECKING:
    from nrsfm.datasets.readers.trackfile import Asked

Y = (AUTO, "down", "up")
ALLOWED = (
    *("method.", "+method.", "cameras.", "+cameras.", "observations.", "limits.memory_gb=", "threads="),
    "hydra.searchpath=",
)


def main(argv: Sequence[str]) -> int:
    """Run the verb; returns its exit code.

    Raises
    ------
    DatasetError
        If the file cannot be used.
    UsageError
        If the command line cannot be used, or the folder holds other files.
    """
    options = command_line().read(argv)
    if odd := [word for word in options.overrides if not word.startswith(ALLOWED)]:
        raise UsageError(
            f"{odd[0]!r} is no override of method., cameras., observations., limits.memory_gb or threads; see --help"
        )
    try:
        return _solve(options)
    except KeyboardInterrupt:
        print("nrsfm solve: interrupted; nothing was written", file=sys.stderr)
        return 130


def _solve(options: argparse.Namespace) -> int:
    from nrsfm.datasets.readers.trackfile import Asked
    from nrsfm.datasets.real.tracks import load_tracks
    from nrsfm.harness.config.plugins import check_choices

    n_bodies = _number(options.bodies)
    check_choices([f"method={options.method}", *options.overrides])
    asked = Asked(_columns(options.columns), options.axes, options.confidence, options.y)
    scene = load_tracks(options.file.expanduser(), asked=asked)  # faults are found before anything slow is loaded
    from nrsfm.harness.config.settings import settings_of
    from nrsfm.harness.record.fault import place_of
    from nrsfm.harness.solving.folder import VIEW, check_folder
    from nrsfm.harness.solving.solve import solve
    from nrsfm.methods.base import MethodError

    settings = settings_of([f"method={options.method}", *options.overrides])
    folder = (options.out or settings.output / "solve" / options.file.name).expanduser()
    check_folder(folder)
    arguments = {
        "method": options.method,
        "cameras": options.cameras,
        "rank": options.rank,
        "overrides": options.overrides,
    }
    again = f"nrsfm run dataset=tracks dataset.file={options.file} method={options.method}{_settings(asked)}"
    try:
        with _progress(f"{scene.n_points} tracks over {scene.n_frames} frames") as progress:
            solution = solve(scene, n_bodies, **arguments, progress=progress)
    except (MethodError, MemoryError) as error:
        message = str(error) or "there is not enough memory; take fewer tracks, or a method for dense tracks (ours_c)"
        print(f"nrsfm solve: {' '.join(message.split())}", file=sys.stderr)
        return 2
    except (UsageError, OSError):
        raise
    except Exception as error:  # a method may raise anything
        message = " ".join(f"{type(error).__name__}: {error}".split())[:500]
        what = f"{options.method} ended with {message} ({place_of(error)})"
        print(f"nrsfm solve: {what}; '{again}' keeps the traceback", file=sys.stderr)
        return 2
    solution.save(folder)
    print(solution)
    print(f"{'written to':<13} {folder}")
    print(f"{'look at it':<13} {(folder / VIEW).resolve().as_uri()}")
    if options.gif:
        solution.animate(options.gif)
        print(f"{'animated in':<13} {options.gif}")
    if options.open:
        import webbrowser

        webbrowser.open((folder / VIEW).resolve().as_uri())
    return 0


def _number(word: str | None) -> int | str | None:
    if word is None or word == AUTO:
        return word
    try:
        return int(word)
    except ValueError:
        raise UsageError(f"--bodies is {word!r}, wanted a whole number or auto") from None


def _columns(word: str | None) -> dict[str, str]:
    """``frame=img,track=id`` as a mapping."""
    pairs = [part.partition("=") for part in word.split(",")] if word else []
    if odd := next(("".join(pair) for pair in pairs if not (pair[0] and pair[2])), None):
        raise UsageError(f"--columns holds {odd!a}, wanted pairs such as frame=img,track=id,x=u,y=v")
    return {role.strip(): name.strip() for role, _, name in pairs}


def _settings(asked: Asked) -> str:
    """The settings of ``dataset=tracks`` that read a file as asked."""
    columns = ",".join(f"{role}: {name}" for role, name in asked.columns.items())
    given = {
        "columns": columns and f"{{{columns}}}",
        "axes": asked.axes and f"'{asked.axes}'",
        "confidence": "" if asked.confidence is None else f"{asked.confidence:g}",
        "y": asked.y,
    }
    return "".join(f' "dataset.{name}={value}"' for name, value in given.items() if value not in ("", AUTO))


class _Bar:
    """A :data:`nrsfm.methods.base.Progress` shown in a terminal."""

    def __init__(self, bars: Any, scene: str) -> None:
        self._bars, self._scene, self._stage = bars, scene, ""
        self._task = bars.add_task(scene, total=None)

    def stage(self, name: str) -> None:
        self._stage = f"{self._scene}: {name}"
        self._bars.update(self._task, description=self._stage, completed=0, total=None)

    def __call__(self, iteration: int, iterations: int, residuals: Mapping[str, float]) -> None:
        words = ", ".join(f"{name} {value:.0e}" for name, value in residuals.items())
        self._bars.update(self._task, completed=iteration, total=iterations, description=f"{self._stage}, {words}")


@contextmanager
def _progress(scene: str) -> Iterator[_Bar | None]:
    """Shows the stage and the iteration in a terminal; None elsewhere."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True) as bars:
        yield _Bar(bars, scene)


def command_line() -> Parser:
    parser = Parser(
        "nrsfm solve",
        "Reconstruct tracks of your own in 3D, and tell the bodies apart. No tracker is needed.",
        """\
nrsfm solve tracks.npz --bodies 2  # arrays: tracks (F, 2, P) or W (2F, P); NaN is not observed
nrsfm solve tracks.mat --bodies 3 --method bmm_ssc3d
nrsfm solve tracks.csv --bodies auto  # a line for each observation: frame,track,x,y[,label][,visible]
nrsfm solve wide.csv --bodies 2  # a line for each frame: x_A,y_A,x_B,y_B,... or A.x,A.y,B.x,B.y,...
nrsfm solve table.csv --columns frame=img,track=id,x=u,y=v --bodies 2
nrsfm solve poses/  # a folder of OpenPose's or COCO's .json files
nrsfm solve take.c3d  # markers in 3D, seen by a camera that circles; the truth is known
nrsfm solve tracks.npz --bodies 2 --rank 7  # cameras from the tracks, which deform in 7 shapes
nrsfm solve tracks.npz --bodies 2 method.max_iter=300 limits.memory_gb=16
nrsfm solve tracks.npz --bodies 2 observations.robust=false observations.scale=false  # keep outliers and zoom""",
        """\
fields of .npz and .mat, all but the tracks optional (rows of a frame stand together):
  tracks or W     (F, 2, P) or (2F, P), rows x, y      visible     (F, P), 1 where a track is observed
  cameras, R, Rs  (F, 2, 3) or (2F, 3), orthonormal    labels, s   (P,), the true body of each track
  structure or S  (F, 3, P) or (3F, P), the truth

read as they are: arrays of CoTracker, TAPIR and SLEAP (.npz .npy .h5), tables of DeepLabCut and SLEAP (.csv),
MOTChallenge (.txt), OpenPose's and COCO's .json. docs/own_tracks.md has them all.

written into the folder: reconstruction.npz, structure.csv, labels.csv, cameras.csv, outliers.csv, affinity.csv,
summary.txt, result.json, ply/frame_0000.ply and so on, and view.html (3D, for any browser, no network).

exit codes: 0 solved, 2 the file cannot be used or the method failed, 3 wrong usage""",
    )
    parser.add_argument("file", type=Path, help="tracks, .npz .npy .mat .h5 .csv .txt .json .c3d, or a folder")
    parser.add_overrides(
        only=("method.", "cameras.", "observations.", "limits.", "threads="),
        more="; of the method, the cameras, the cleaning of the tracks, memory or threads",
    )
    words = "how many bodies there are, or auto to have them counted, which is seldom right"
    parser.add_argument("--bodies", metavar="N", help=f"{words}; left out, the number of the file's labels")
    parser.add_words("--method", group_choices("method"), default="adaptive", help="any of 'nrsfm list methods'")
    parser.add_argument(
        "--cameras",
        choices=("auto", "known", "estimated", "refined"),
        default="auto",
        help="the file's, if it has some",
    )
    parser.add_argument("--rank", type=int, metavar="K", help="shapes that the estimation of cameras allows (11)")
    parser.add_argument("--columns", metavar="A=B,...", help="the file's names: frame=img,track=id,x=u,y=v; tracks=xy")
    parser.add_argument("--axes", default="", help="of an array, where unclear: F frames, P tracks, 2 x and y; F,P,2")
    parser.add_argument("--confidence", type=float, metavar="C", help="below it a position counts as not observed")
    parser.add_argument("--y", choices=Y, default=AUTO, help="where y points in the image; down in pixels")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="where to write (solve/FILE in NRSFM_OUTPUT)")
    parser.add_argument("--gif", type=Path, metavar="FILE", help="also write a moving picture")
    parser.add_argument("--open", action="store_true", help="open the 3D view in a browser")
    return parser
