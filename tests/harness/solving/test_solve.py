"""``nrsfm solve`` and its Python calls: files in, files out, on real files and in real processes."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import scipy.io

from nrsfm.datasets.errors import DatasetError
from nrsfm.datasets.generated import procedural
from nrsfm.datasets.scene import Scene
from nrsfm.harness.evaluate.errors import n_wrong
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.solving.folder import NAMES, VIEW
from nrsfm.harness.solving.solution import Solution
from nrsfm.harness.solving.solve import load, solve
from nrsfm.methods.base import Method, MethodError, Observations, Reconstruction
from nrsfm.methods.multibody.adaptive import AdaptiveMultiBody
from nrsfm.reports.figures.style import COLOURS
from tests.shell import ROOT, Shell, started, until

README, PAGE = ROOT / "README.md", ROOT / "docs/own_tracks.md"


@pytest.fixture(scope="module")
def scene() -> Scene:
    return procedural.load_scene(["person", "face"], 15, 40, 0, name="two", placement="paper")


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def to_npz(folder: Path, scene: Scene) -> Path:
    held = {"tracks": scene.tracks, "structure": scene.structure, "labels": scene.labels, "cameras": scene.cameras}
    parts: dict[str, Any] = {name: value for name, value in held.items() if value is not None}
    np.savez(folder / "tracks.npz", **parts)
    return folder / "tracks.npz"


def to_mat(folder: Path, scene: Scene) -> Path:
    """Without cameras."""
    assert scene.structure is not None and scene.labels is not None
    held = {"W": scene.tracks.reshape(-1, scene.n_points), "S": scene.structure.reshape(-1, scene.n_points)}
    scipy.io.savemat(folder / "tracks.mat", held | {"s": scene.labels + 1.0})
    return folder / "tracks.mat"


def to_csv(folder: Path, scene: Scene) -> Path:
    """In pixels, without cameras and structure."""
    assert scene.labels is not None
    with (folder / "tracks.csv").open("w") as stream:
        stream.write("frame,track,x,y,label\n")
        for f, p in np.argwhere(~np.isnan(scene.tracks[:, 0])):
            x, y = 80 * scene.tracks[f, :, p] + 300
            stream.write(f"{f + 7},m{p},{x:.4f},{y:.4f},{'AB'[scene.labels[p]]}\n")
    return folder / "tracks.csv"


@pytest.mark.parametrize("write", [to_npz, to_mat, to_csv], ids=["npz", "mat", "csv"])
@pytest.mark.parametrize("gaps", [False, True], ids=["whole", "gaps"])
def test_two_bodies_are_told_apart(
    write: Callable[[Path, Scene], Path], gaps: bool, scene: Scene, tmp_path: Path, nrsfm: Shell
) -> None:
    held = scene.with_gaps("random", 0.1) if gaps else scene
    done = nrsfm("solve", str(write(tmp_path, held)), "--bodies", "2")
    assert done.returncode == 0, done.stderr
    said = dict(re.findall(r"^(\S+) {2,}(.*)$", done.stdout, re.MULTILINE))
    assert said["frames"] == "40"
    assert said["tracks"] == ("30, 10.0% of" if gaps else "30, none of") + " the observations missing"
    assert "0 of 30 tracks wrong" in said["e_MS"]
    one, two = {"to_npz": ("label 0", "label 1"), "to_mat": ("label 1", "label 2")}.get(write.__name__, ("A", "B"))
    assert said["bodies"] == f"2 ({one}: 15 tracks, {two}: 15 tracks)"
    assert said["cameras"] == ("from the file" if write is to_npz else "from the tracks, K = 11")
    assert re.search(r"\d+ iterations, residual .* the tolerance 0\.001", said["convergence"])
    assert ("e_3D" in said) == (write is not to_csv)
    if write is not to_csv:
        assert float(said["e_3D"].split()[0]) < 0.12
    (folder,) = (tmp_path / "out/solve").iterdir()
    assert names(folder) == NAMES
    assert not list(folder.parent.glob(".*"))  # nothing half


def test_a_table_of_other_names_stands_upright(scene: Scene, tmp_path: Path, nrsfm: Shell) -> None:
    """Pixels, y downwards, semicolons and decimal commas: the structure has y upwards as in the picture."""
    lines = ["bild;id;u;v;note"]
    for f, p in np.ndindex(scene.n_frames, scene.n_points):
        u, v = 80 * scene.tracks[f, :, p] * [1, -1] + 300
        lines.append(f"img_{f}.png;m{p};{u:.3f};{v:.3f};-".replace(".", ",").replace(",png", ".png"))
    (tmp_path / "pixels.csv").write_text("\n".join(lines))
    columns = ("--columns", "frame=bild,track=id,x=u,y=v")
    done = nrsfm("solve", "pixels.csv", "--bodies", "2", "--method", "bmm_ssc3d", *columns)
    assert done.returncode == 0, done.stderr
    assert "not used: column note" in done.stdout and "y points down, as in images" in done.stdout
    with np.load(tmp_path / "out/solve/pixels.csv/reconstruction.npz") as stored:
        image = stored["cameras"] @ stored["structure"]
        assert stored["frame_ids"][10] == "img_10.png"
    np.testing.assert_allclose(image, 80 * scene.tracks, atol=0.1 * 80)
    wrong = nrsfm("solve", "pixels.csv", "--bodies", "2", "--columns", "frame")
    assert wrong.returncode == 3 and "--columns holds 'frame', wanted pairs such as frame=img" in wrong.stderr


def test_what_is_written_agrees(scene: Scene, tmp_path: Path) -> None:
    held = scene.with_gaps("random", 0.1)
    solution = solve(load(to_csv(tmp_path, held)), 2)
    folder = solution.save(tmp_path / "found")
    S, R, labels = solution.structure, solution.cameras, solution.labels
    assert S is not None and R is not None and labels is not None and solution.affinity is not None
    with np.load(folder / "reconstruction.npz") as stored:
        np.testing.assert_allclose(stored["structure"], S, rtol=1e-6, atol=1e-4)
        np.testing.assert_array_equal(stored["labels"], labels)
        np.testing.assert_allclose(stored["cameras"], R, atol=1e-6)
        np.testing.assert_allclose(stored["affinity"], solution.affinity, atol=1e-6)
        ids = stored["track_ids"].tolist()
        assert stored["frame_ids"][0] == "7" and set(ids) == {f"m{p}" for p in range(30)}
        assert stored["bodies"].tolist() == ["A", "B"]
    rows = list(csv.DictReader((folder / "structure.csv").open()))
    assert len(rows) == 40 * 30
    for k in (0, 31, 1199):
        f, p = divmod(k, 30)
        assert (rows[k]["frame"], rows[k]["track"], rows[k]["label"]) == (f"{f + 7}", ids[p], "AB"[labels[p]])
        np.testing.assert_allclose([float(rows[k][axis]) for axis in "xyz"], S[f, :, p], rtol=1e-6)
    told = list(csv.DictReader((folder / "labels.csv").open()))
    assert {row["track"]: row["true_label"] for row in told} == {f"m{p}": "AB"[p // 15] for p in range(30)}
    cameras = np.loadtxt(folder / "cameras.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(cameras[:, 1:7].reshape(-1, 2, 3), R, rtol=1e-12)
    assert (cameras[:, 7] == 1).all() and (folder / "outliers.csv").read_text() == "frame,track,residual\n"
    pairs = list(csv.DictReader((folder / "affinity.csv").open()))
    assert len(pairs) == np.count_nonzero(np.triu(solution.affinity, k=1))
    clouds = sorted((folder / "ply").iterdir())
    assert [path.name for path in clouds[:2]] == ["frame_0000.ply", "frame_0001.ply"] and len(clouds) == 40
    cloud = read_ply(clouds[5])
    np.testing.assert_allclose(np.stack([cloud[axis] for axis in "xyz"]), S[5], rtol=1e-6)
    np.testing.assert_array_equal(cloud["label"], labels)
    colours = [f"#{r:02X}{g:02X}{b:02X}" for r, g, b in zip(cloud["red"], cloud["green"], cloud["blue"], strict=True)]
    assert colours == [COLOURS[k] for k in labels]
    assert (folder / "summary.txt").read_text() == f"{solution}\n"
    record = json.loads((folder / "result.json").read_text())
    assert record["metrics"]["n_wrong"] == 0 and record["data"] == solution.scene.digest
    trust = solution.trust
    assert trust is not None and record["trust"]["verdict"] == trust.verdict
    assert str(solution).splitlines()[1] == f"trust         {trust}" and "<dt>trust</dt>" in (folder / VIEW).read_text()
    np.testing.assert_allclose(record["trust"]["tracks"], trust.tracks, rtol=1e-3)


def read_ply(path: Path) -> Any:
    """A binary .ply of one element, as the format's own header describes it."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = head.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    codes = {"float": "<f4", "uchar": "u1", "int": "<i4"}
    kind = [(words[2], codes[words[1]]) for words in map(str.split, lines) if words[0] == "property"]
    points = np.frombuffer(body, kind)
    assert f"element vertex {len(points)}" in lines
    return points


def test_outliers_and_zoom_are_taken_out_and_listed(scene: Scene, tmp_path: Path) -> None:
    """Structure is at scale 1; both switches leave the tracks as they are."""
    spoilt = scene.with_corruption(outliers=0.03, zoom=0.3, zooming="random")
    bad = spoilt.tracks != scene.with_corruption(zoom=0.3, zooming="random").tracks
    solution, plain = solve(spoilt), solve(scene)
    assert solution.scales is not None and solution.outliers is not None and solution.structure is not None
    assert solution.metrics["n_wrong"] == 0 and solution.metrics["e_3d"] < 1.3 * plain.metrics["e_3d"]
    assert solution.metrics["reprojection"] < 0.02
    assert (solution.outliers & bad.any(axis=1)).sum() > 0.9 * bad.any(axis=1).sum()
    factors = np.linalg.norm(scene.with_corruption(zoom=0.3, zooming="random").tracks, axis=(1, 2))
    factors /= np.linalg.norm(scene.tracks, axis=(1, 2))
    assert np.std(np.log(solution.scales / factors)) < 0.02
    facts = dict(solution.facts())
    assert re.fullmatch(r"\d+ of the observations \(\d\.\d+%\), on \d+ of the tracks; taken .*", facts["outliers"])
    assert re.match(r"from 0\.\d+ to 1\.\d+, taken out", facts["image scale"])
    folder = solution.save(tmp_path / "found")
    rows = list(csv.DictReader((folder / "outliers.csv").open()))
    record = json.loads((folder / "result.json").read_text())
    assert {(row["frame"], row["track"]) for row in rows} == {(o["frame"], o["track"]) for o in record["outliers"]}
    assert len(rows) == solution.outliers.sum()
    assert np.median([float(row["residual"]) for row in rows]) > 10 * np.sqrt(np.mean(spoilt.tracks**2)) * 0.02
    np.testing.assert_allclose(record["scales"], solution.scales)
    off = solve(spoilt, overrides=["observations.robust=false", "observations.scale=false"], max_iter=3)
    assert off.scales is None and off.outliers is None and "image scale" not in dict(off.facts())


def test_the_structure_reprojects_in_the_units_of_the_file(scene: Scene, tmp_path: Path) -> None:
    mine = load(to_csv(tmp_path, scene))
    solution = solve(mine, 2)
    assert solution.structure is not None and solution.cameras is not None and solution.outliers is not None
    kept = np.where(solution.outliers[:, None], np.nan, mine.tracks)
    off = kept - np.nanmean(kept, axis=2, keepdims=True) - solution.cameras @ solution.structure
    off -= np.nanmean(off, axis=2, keepdims=True)
    rms = np.sqrt(np.nanmean(np.sum(off**2, axis=1)))
    assert rms < 0.5  # pixels, of some 100
    assert f"{rms:.3g} in their units" in str(solution)


def test_names_that_need_care(scene: Scene, tmp_path: Path) -> None:
    """Commas, quotes, per cents and markup in names come back as they were."""
    odd = ['a,"b"', "100%s", "<script>x</script>", *(f"t{k}" for k in range(3, 30))]
    with (tmp_path / "odd.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["frame", "track", "x", "y"])
        writer.writerows([f"{f}%d", odd[p], *scene.tracks[f, :, p]] for f in range(40) for p in range(30))
    folder = solve(tmp_path / "odd.csv", 2).save(tmp_path / "found")
    rows = list(csv.DictReader((folder / "structure.csv").open(newline="")))
    assert [row["track"] for row in rows[:30]] == odd and rows[-1]["frame"] == "39%d"
    assert "<script>x" not in (folder / "view.html").read_text()


def test_counting_is_said_to_be_unsure(scene: Scene, tmp_path: Path, nrsfm: Shell) -> None:
    done = nrsfm("solve", str(to_npz(tmp_path, scene)), "--bodies", "auto")
    assert done.returncode == 0 and "counted by the method, which is often wrong: give the number" in done.stdout


def test_any_method_and_setting(scene: Scene, tmp_path: Path, nrsfm: Shell) -> None:
    path = str(to_npz(tmp_path, scene))
    done = nrsfm("solve", path, "--method", "ssc2d", "method.clusterer.share=0.7", "--out", "labels only")
    assert done.returncode == 0 and "no structure" not in done.stderr
    held = names(tmp_path / "labels only")
    assert held == NAMES - {"structure.csv", "cameras.csv", "ply"}
    assert "cameras       not used" in done.stdout and "reprojection" not in done.stdout
    for cameras, said in (("estimated", "the tracks, K = 3"), ("refined", "the tracks, K = 3, refined")):
        done = nrsfm("solve", path, "--method", "bmm", "--cameras", cameras, "--rank", "3", "method.max_iter=50")
        assert done.returncode == 0 and f"from {said}\n" in done.stdout and "bodies" not in done.stdout
    again = nrsfm("solve", path, "method.max_iter=2")
    assert "2 iterations" in again.stdout and "NOT below the tolerance" in again.stdout
    assert "bodies" in again.stdout  # its own folder, written anew


def test_python_takes_settings_methods_and_progress(scene: Scene) -> None:
    seen: list[int] = []
    few = solve(scene, method="adaptive", max_iter=3, progress=lambda i, n, r: seen.append(i))
    assert seen[-3:] == [1, 2, 3] and few.parameters["max_iter"] == 3 and few.convergence is not None
    assert few.convergence.iterations == 3 and not few.convergence.met

    class Halves(Method):
        """Labels alone."""

        provides = frozenset({"labels"})
        uses_cameras = False

        def reconstruct(self, observations: Observations, n_bodies: int | None) -> Reconstruction:
            n_points = observations.tracks.shape[2]
            return Reconstruction(labels=np.arange(n_points) * 2 // n_points + 5)

    own = solve(scene, 2, method=Halves())
    assert own.labels is not None and n_wrong(own.labels, np.repeat([0, 1], 15)) == 0
    assert own.method == "Halves" and own.structure is None and own.metrics["n_wrong"] == 0
    nested = solve(scene, 2, method="ssc2d", clusterer={"share": 0.7})
    assert nested.parameters["clusterer"]["share"] == 0.7 and nested.parameters["clusterer"]["alpha"] == 800.0


def test_bad_arguments_of_python(scene: Scene) -> None:
    unlabelled = procedural.load_scene(["person", "face"], 8, 12, 0, name="x", placement="paper")
    object.__setattr__(unlabelled, "labels", None)
    cases: tuple[tuple[Callable[[], Solution], type[Exception], str], ...] = (
        (lambda: solve(unlabelled), UsageError, "how many bodies are there?"),
        (lambda: solve(scene, 0), UsageError, "n_bodies is 0, wanted auto or a whole number from 1 to the 30 tracks"),
        (lambda: solve(scene, cast(int, 2.5)), UsageError, "n_bodies is 2.5"),
        (lambda: solve(scene, 2, cameras="mine"), UsageError, "cameras is 'mine', wanted one of auto"),
        (lambda: solve(scene, 2, method="none"), UsageError, "none"),
        (lambda: solve(scene, 2, method="adaptive", speed=9), MethodError, "its hyper-parameters are l1"),
        (lambda: solve("nowhere.npz", 2), DatasetError, "nowhere.npz is not there"),
    )
    for call, kind, said in cases:
        with pytest.raises(kind, match=re.escape(said)):
            call()
    with pytest.raises(AttributeError, match="no attribute 'sovle'"):
        __import__("nrsfm").sovle  # noqa: B018


COMMANDS: dict[str, tuple[int, tuple[str, ...]]] = {
    "none.npz is not there; name a file of tracks": (2, ("none.npz", "--bodies", "2")),
    "its header holds x; wanted the header frame,track,x,y": (2, ("notes.txt", "--bodies", "2")),
    "not a readable .npz file": (2, ("bad.npz", "--bodies", "2")),
    "how many bodies are there? Set": (3, ("bare.npz",)),
    "there are no cameras in the file": (3, ("bare.npz", "--bodies", "2", "--cameras", "known")),
    "--bodies is 'two', wanted a whole number or auto": (3, ("bare.npz", "--bodies", "two")),
    "n_bodies is 0, wanted auto or": (3, ("bare.npz", "--bodies", "0")),
    "n_bodies is 31": (3, ("bare.npz", "--bodies", "31")),
    "nomethod": (3, ("bare.npz", "--bodies", "2", "--method", "nomethod")),
    "'noise.level=1' is no override of method.": (3, ("bare.npz", "--bodies", "2", "noise.level=1")),
    "cameras.rank is 0, wanted a whole number": (2, ("bare.npz", "--bodies", "2", "--rank", "0")),
    "its hyper-parameters are": (2, ("bare.npz", "--bodies", "2", "+method.speed=9")),
    "limits.memory_gb is 0.01; raise it": (3, ("bare.npz", "--bodies", "2", "limits.memory_gb=0.01")),
    "bare.npz (Not a directory); choose another with --out": (
        3,
        ("bare.npz", "--bodies", "2", "--out", "bare.npz/x"),
    ),
    "mine exists and is no solution of nrsfm solve": (3, ("bare.npz", "--bodies", "2", "--out", "mine")),
    "notes.txt exists and is no solution": (3, ("bare.npz", "--bodies", "2", "--out", "notes.txt")),
    "'letter.txt', which would be lost": (3, ("bare.npz", "--bodies", "2", "--out", "shared")),
    "the following arguments are required": (3, ()),
    "cannot be estimated from": (2, ("short.npz", "--bodies", "2")),
}


@pytest.mark.parametrize("said", COMMANDS)
def test_commands_that_cannot_be_carried_out(said: str, scene: Scene, tmp_path: Path, nrsfm: Shell) -> None:
    np.savez(tmp_path / "bare.npz", tracks=scene.tracks)
    np.savez(tmp_path / "short.npz", tracks=scene.tracks[:2])
    (tmp_path / "notes.txt").write_text("x")
    (tmp_path / "bad.npz").write_text("x")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").write_text("years of work")
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared/result.json").write_text('{"made_by": "nrsfm solve"}')
    (tmp_path / "shared/letter.txt").write_text("dear")
    code, arguments = COMMANDS[said]
    done = nrsfm("solve", *arguments)
    assert done.returncode == code and said in done.stderr, done.stderr
    assert len(done.stderr.splitlines()) == 1 and done.stdout == ""
    assert (tmp_path / "mine/thesis.tex").read_text() == "years of work"
    assert not (tmp_path / "out/solve").exists()


def test_help_teaches_by_example(nrsfm: Shell) -> None:
    done = nrsfm("solve", "--help")
    assert done.returncode == 0 and "nrsfm solve tracks.npz --bodies 2" in done.stdout
    assert "exit codes: 0 solved, 2" in done.stdout


@pytest.mark.parametrize("error", [RuntimeError("it\nbroke"), MemoryError(), MethodError("it cannot")])
def test_a_method_that_fails_is_one_line(
    error: Exception, scene: Scene, tmp_path: Path, nrsfm: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    monkeypatch.setattr(AdaptiveMultiBody, "reconstruct", fail)
    done = nrsfm("solve", str(to_npz(tmp_path, scene)))
    said = {
        RuntimeError: "RuntimeError: it broke (solving/test_solve.py:",
        MemoryError: "not enough memory",
        MethodError: "it cannot",
    }
    assert done.returncode == 2 and said[type(error)] in done.stderr and len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out/solve").exists()


HALVES = '''
import numpy as np
from nrsfm.methods.base import Method, Reconstruction

class Halves(Method):
    """Labels alone."""
    provides = frozenset({"labels"})
    uses_cameras = False
    def reconstruct(self, observations, n_bodies):
        n_points = observations.tracks.shape[2]
        return Reconstruction(labels=np.arange(n_points) * n_bodies // n_points)
'''


def test_a_method_of_another_package(scene: Scene, tmp_path: Path, shell: Shell) -> None:
    package = tmp_path / "site/theirs"
    (package / "conf/method").mkdir(parents=True)
    (package / "__init__.py").write_text(HALVES)
    (package / "conf/method/halves.yaml").write_text("# Halves.\nname: halves\nalgorithm: halves\n")
    info = tmp_path / "site/theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[nrsfm.methods]\nhalves = theirs:Halves\n")
    path = os.pathsep.join([str(tmp_path / "site"), str(ROOT)])
    done = shell("solve", str(to_npz(tmp_path, scene)), "--method", "halves", PYTHONPATH=path)
    assert done.returncode == 0 and "0 of 30 tracks wrong" in done.stdout, done.stderr


WRITER = """
import sys, time
from pathlib import Path
from nrsfm.harness.solving.solution import Solution
from nrsfm.harness.solving.solve import solve
Solution.page = lambda solution: (print("writing", flush=True), time.sleep(600))
solve(sys.argv[1], 2).save(sys.argv[2])
"""


def test_killed_while_it_writes_leaves_nothing_half(scene: Scene, tmp_path: Path, environment: dict[str, str]) -> None:
    path, folder = to_npz(tmp_path, scene), tmp_path / "found"
    for before in (False, True):  # there was none, there was one
        if before:
            solve(path, 2).save(folder)
            assert not list(tmp_path.glob(".found.*"))  # what the killed one left
            old = (folder / "summary.txt").read_bytes()
        command = [sys.executable, "-c", WRITER, str(path), str(folder)]
        with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None and child.stdout.readline() == "writing\n"
            assert folder.exists() == before
            child.kill()
        assert len(list(tmp_path.glob(".found.*"))) == 1
    assert (folder / "summary.txt").read_bytes() == old and names(folder) == NAMES


def test_ctrl_c_leaves_one_line(scene: Scene, tmp_path: Path, environment: dict[str, str]) -> None:
    path = to_npz(tmp_path, scene)
    child = started(
        environment, tmp_path, "solve", str(path), "--method", "ours", "method.max_iter=100000000",
        "method.tol=1e-300",
    )  # fmt: skip
    until(lambda: cpu(child.pid) > 3)  # it has read the file and iterates
    os.killpg(child.pid, signal.SIGINT)
    _, err = child.communicate(timeout=600)
    assert child.returncode == 130 and err == "nrsfm solve: interrupted; nothing was written\n"
    assert not (tmp_path / "out/solve").exists()


def cpu(pid: int) -> float:
    """Seconds of processor time."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def test_importing_the_package_stays_light() -> None:
    code = "import nrsfm, sys; assert 'numpy' not in sys.modules; nrsfm.solve; assert 'mlflow' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


@pytest.fixture
def readers_folder(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as the README's reader has it."""
    for write in (to_npz, to_mat, to_csv):
        write(tmp_path, scene)
    shutil.copy(tmp_path / "tracks.npz", tmp_path / "dancers.npz")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def section() -> str:
    return README.read_text().partition("## Tracks of your own\n")[2].partition("\n## ")[0]


def test_the_lines_of_the_readme(readers_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    block = re.search(r"(?m)^    from nrsfm import load, solve\n(?:    .*\n|\n)+", section())
    assert block is not None
    lines = [line.strip() for line in block.group().splitlines() if line.strip()]
    assert len(lines) == 6  # the import, and five
    held: dict[str, Any] = {}
    exec("\n".join(lines), held)
    assert isinstance(held["solution"], Solution) and held["solution"].metrics["n_wrong"] == 0
    assert names(readers_folder / "found") == NAMES
    page = Path(opened[0].removeprefix("file://"))
    assert "<title>dancers</title>" in page.read_text()
    page.unlink()
    page.parent.rmdir()


def test_the_commands_of_the_documents(readers_folder: Path, nrsfm: Shell) -> None:
    found = [
        command for text in (section(), PAGE.read_text()) for command in re.findall(r"(?m)^(?:    )?nrsfm (.*)$", text)
    ]
    commands = list(dict.fromkeys(found))
    assert len(commands) == 8
    for command in (command.partition("#")[0].strip() for command in commands):
        if command == "data example":
            (readers_folder / "dancers.npz").unlink()
        done = nrsfm(*command.split(), *(["dataset.name=mine"] if command.startswith("run") else []))
        assert done.returncode == 0, done.stderr
        assert "wrong" in done.stdout or command.startswith("data")


@pytest.mark.data
@pytest.mark.parametrize("cameras", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["known", "estimated"])
def test_a_real_pair(cameras: bool, data_folder: Path, tmp_path: Path) -> None:
    """What the tables say of dance + yoga, from a file."""
    from nrsfm.datasets.real import mocap

    real = mocap.load_scene(data_folder, ["dance", "yoga"])
    object.__setattr__(real, "cameras", real.cameras if cameras else None)
    solution = solve(to_npz(tmp_path, real), 2)
    assert solution.metrics["n_wrong"] == 0
    assert solution.metrics["e_3d_dai"] == pytest.approx(0.0267 if cameras else 0.046, abs=1e-4 if cameras else 0.02)


def test_time_is_spent_on_solving(scene: Scene, tmp_path: Path) -> None:
    """A million positions are written in seconds of processor time, not minutes."""
    F, P = 50, 20_000
    rng = np.random.default_rng(0)
    large = Scene("large", rng.standard_normal((F, 2, P)))
    found = Reconstruction(labels=np.arange(P) % 3, structure=rng.standard_normal((F, 3, P)))
    solution = Solution(large, found, "none", {}, "no cameras", False, 0.0)
    start = time.process_time()  # of this process: other work on the machine does not count
    solution.save(tmp_path / "large")
    assert time.process_time() - start < 60
    assert (tmp_path / "large/view.html").stat().st_size < 30 * 2**20
