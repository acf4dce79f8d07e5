"""Makes the table of docs/trust.md: the error that is expected beside the true one, on scenes good and bad.

Scenes are solved as ``nrsfm solve`` does it, outliers and zoom taken out first: the eight pairs before cameras that
turn slowly or not at all, with zoom, with outliers, and with files read in a wrong layout. All cases take a while.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from nrsfm import solve
from nrsfm.datasets.registry import load_scene
from nrsfm.datasets.scene import Scene
from nrsfm.harness.config.compose import data_folder
from nrsfm.harness.config.spans import expand
from nrsfm.harness.evaluate.trust import GOOD, VERDICTS

PAIRS = (
    *("dance_yoga", "drink_walking", "shark_stretch", "walking_yoga"),
    *("face_pickup", "face_yoga", "shark_yoga", "stretch_yoga"),
)
SOME = ("dance_yoga", "face_pickup")
WRONG = 0.5  # the true error of a structure that nobody should rely on
FITTED = ("a frame", "a fixed camera", "outliers")  # ends of the kinds that the constants are fitted on
START, END = "<!-- trust -->", "<!-- end trust -->"


@dataclass(frozen=True)
class Case:
    """A scene, whether its cameras are known, and the row of the table that it belongs to."""

    kind: str
    scene: Scene
    known: bool


@dataclass(frozen=True)
class Result:
    """What became of a case; the true error is infinite where the layout leaves no truth to compare with."""

    kind: str
    true: float
    expected: float
    verdict: str


def cases() -> Iterator[Case]:
    """All cases of the table, each with known and with estimated cameras where it has some."""
    for degrees in (5, 1, 0.3, 0):
        for pair in PAIRS:
            kind = f"{degrees} degrees a frame" if degrees else "a fixed camera"
            yield from both(kind, scene_of(f"dataset={pair}", f"dataset.degrees_per_frame={degrees}"))
    for pair in PAIRS:
        native = scene_of(f"dataset={pair}", "dataset.motion=native", "dataset.placement=[3,0,0]")
        yield from both("bodies that turn by themselves", native)
    for take in range(1, 5):
        yield from both("salsa", scene_of("dataset=two_person", f"dataset.take=salsa_0{take}"))
    for pair in SOME:
        scene = scene_of(f"dataset={pair}")
        yield from both("zoom of 30 %", scene.with_corruption(zoom=0.3))
        for share in (0.01, 0.05, 0.1):
            yield from both(f"{share:.0%} outliers".replace("%", " %"), scene.with_corruption(outliers=share))
        yield Case("x and y swapped, known cameras", replace(scene, tracks=scene.tracks[:, ::-1].copy()), known=True)
        yield Case("blocks of x and y read as rows of frames", as_blocks(scene), known=False)
        yield Case("frames and tracks swapped", transposed(scene), known=False)


def both(kind: str, scene: Scene) -> Iterator[Case]:
    """The case with known and with estimated cameras."""
    for known in (True, False):
        yield Case(f"{kind}, {'known' if known else 'estimated'} cameras", scene, known)


def scene_of(*words: str) -> Scene:
    ((trial, _),) = expand(list(words))
    return load_scene(trial.dataset, data_folder())


def as_blocks(scene: Scene) -> Scene:
    """All rows of x and then all rows of y, taken for x and y of one frame after the other."""
    blocks = np.concatenate([scene.tracks[:, 0], scene.tracks[:, 1]])
    return replace(scene, tracks=blocks.reshape(scene.tracks.shape), cameras=None)


def transposed(scene: Scene) -> Scene:
    """A (2F, P) file taken for one of P / 2 frames and 2F tracks, which have no truth."""
    n = scene.n_points // 2
    W = scene.tracks.reshape(-1, scene.n_points).T[: 2 * n]
    return Scene(scene.name, W.reshape(n, 2, -1).copy())


def tried(case: Case) -> Result:
    solution = solve(case.scene, 2, cameras="known" if case.known else "estimated")
    trust = solution.trust
    assert trust is not None
    return Result(case.kind, solution.metrics.get("e_3d_dai", float("inf")), trust.expected, trust.verdict)


def table(results: list[Result]) -> str:
    """The table, and the sentence that sums it up."""
    lines = ["| Scenes | Cases | True e_3D | Expected e_3D | Good | Doubtful | Not determined |"]
    lines.append("|---|---|---|---|---|---|---|")
    for kind in dict.fromkeys(result.kind for result in results):
        of_kind = [result for result in results if result.kind == kind]
        true, expected = (spans([getattr(result, name) for result in of_kind]) for name in ("true", "expected"))
        counts = [str(sum(result.verdict == verdict for result in of_kind)) for verdict in VERDICTS]
        lines.append(f"| {' | '.join([kind, str(len(of_kind)), true, expected, *counts])} |")
    known = [result for result in results if np.isfinite(result.true)]
    checked = [result for result in known if not result.kind.split(",")[0].endswith(FITTED)]
    rho, apart = (spearmanr([r.true for r in part], [r.expected for r in part])[0] for part in (known, checked))
    wrong = [result.verdict for result in results if result.true > WRONG]
    right = [result.verdict for result in results if result.true < GOOD]
    missed, cautious = wrong.count("good"), len(right) - right.count("good")
    lines += [
        "",
        f"Of {len(results)} solutions, {len(wrong)} have a true error above {WRONG}, or no truth: {missed} of these",
        f"are called good. {len(right)} have one below {GOOD}: {cautious} of these are not called good. The rank",
        f"correlation of expected and true error is {rho:.2f} over all of them, and {apart:.2f} over those that took",
        "no part in the calibration.",
    ]
    return "\n".join(lines)


def spans(values: list[float]) -> str:
    """``.012 to .34``, or that there are none."""
    finite = [value for value in values if np.isfinite(value)]
    return f"{min(finite):.3f} to {max(finite):.3f}" if finite else "no truth"


def main(page: Path) -> None:
    """Write the table into the page, between its marks; a line for each case goes to stderr."""
    results = []
    for case in cases():
        results.append(tried(case))
        print(case.scene.name, results[-1], file=sys.stderr, flush=True)
    head, _, rest = page.read_text(encoding="utf-8").partition(START)
    page.write_text(f"{head}{START}\n{table(results)}\n{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
