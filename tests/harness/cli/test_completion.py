"""Completion: the answers, and what a tab does in a real bash, zsh and fish."""

from __future__ import annotations

import io
import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from nrsfm.harness.cli.completion import SHELLS, Finder
from nrsfm.harness.cli.verbs import VERBS
from tests.shell import ROOT, Shell

Ask = Callable[[str], dict[str, str]]


def variables(line: str) -> dict[str, str]:
    """The environment in which fish asks argcomplete for the words at the end of a line."""
    words = {"COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE": "1", "_ARGCOMPLETE_SHELL": "fish"}
    return words | {"_ARGCOMPLETE_IFS": "\n", "_ARGCOMPLETE_DFS": "\t", "_ARGCOMPLETE_SUPPRESS_SPACE": "1"}


@pytest.fixture
def ask(monkeypatch: pytest.MonkeyPatch) -> Ask:
    """Gives the words that complete a line after ``nrsfm``, each with its explanation."""

    def call(line: str) -> dict[str, str]:
        output = io.StringIO()
        with monkeypatch.context() as patch:
            patch.setattr(Finder, "_init_debug_stream", lambda finder: None)  # it takes pytest's file descriptor 9
            for name, value in variables(f"nrsfm {line}").items():
                patch.setenv(name, value)
            Finder().answer(exit_method=str, output_stream=output)
        return dict(answer.split("\t") for answer in output.getvalue().splitlines())

    return call


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("", [*VERBS]),
        ("re", ["report"]),
        ("--v", ["--version"]),
        ("report --f", ["--folder", "--figures"]),
        ("report --quiet table1 --c", ["--config-dir", "--claims"]),
        ("report table1 --folder out conv", ["convergence"]),
        ("bless ", ["quick", "tables"]),
        ("solve tracks.npz --method adaptive_ap", ["adaptive_apart"]),
        ("solve tracks.npz --cameras ", ["auto", "known", "estimated", "refined"]),
        ("solve tracks.npz method.max_", ["method.max_iter="]),
        ("bless quick comp", ["compare=", "compare."]),
        ("run lim", ["limits.memory_gb=", "limits.seconds=", "limits.sweep_seconds="]),
        ("run -m method=edsc -m noise.l", ["noise.level="]),
        ("data ", ["list", "get", "verify", "where", "example"]),
        ("data get dri", ["drink", "drink.mat"]),
        ("list d", ["datasets"]),
        ("new ", ["method", "dataset"]),
        ("new method mine ", []),
        ("run --cfg ", ["job", "hydra", "all"]),
        ("run noise.l", ["noise.level="]),
        ("run dataset.bod", ["dataset.bodies="]),
        ("run dataset.bodies=", []),
        ("run noise=", ["noise=gaussian"]),
        ("run rerun=", ["rerun=none", "rerun=failed", "rerun=stale", "rerun=all"]),
        ("run limits.seconds=", ["limits.seconds=3600"]),
        ("run dataset=dance_yoga method=edsc,ou", [f"method=edsc,{n}" for n in ("ours", "ours_c")]),
        ("run method=edsc,edsc_r", ["method=edsc,edsc_raw"]),
        ("run -m exp", ["experiment="]),
        ("plan experiment=dense", [f"experiment=dense{end}" for end in ("", "_full", "_full_99")]),
        ("run method=edsc method.clusterer.dim", ["method.clusterer.dimension="]),
        ("run method=a,b dataset=[ method=no method.l", ["method.l1="]),  # what cannot be used is passed over
        ("run hydra/launcher=jo", ["hydra/launcher=joblib"]),
        ("run 'cameras=", ["cameras=estimated", "cameras=known", "cameras=refined"]),
        ("solve tracks.npz ", ["threads=", "cameras.", "limits.", "method.", "observations."]),
        ("solve tracks.npz --method bmm_", ["bmm_lrr3d", "bmm_ssc3d", "bmm_ssc3d_k11", "bmm_ssc3d_share70"]),
        ("solve tracks.npz --cameras ", ["auto", "known", "estimated", "refined"]),
    ],
)
def test_what_may_stand_next(ask: Ask, line: str, offered: list[str]) -> None:
    words = list(ask(line))
    assert set(offered) <= set(words) if line.endswith("ou") else words == offered


def test_groups_stand_where_they_can_be_given(ask: Ask) -> None:
    plain, added, removed = ask("run "), ask("run +"), ask("run ~")
    assert {"dataset=", "method=", "dataset.", "experiment="} <= plain.keys()
    assert "part=" not in plain
    assert not {"+experiment=", "experiment=", "+dataset=", "+part="} & added.keys()
    assert "~noise" in removed


def test_paths_are_completed(ask: Ask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lab").mkdir()
    (tmp_path / "letter.txt").touch()
    monkeypatch.chdir(tmp_path)
    assert list(ask("run output=./l")) == ["output=./lab/", "output=./letter.txt"]
    for line in ("solve l", "report --folder l"):
        assert ask(line).keys() == {"lab/", "letter.txt"}


def test_what_a_folder_of_configurations_holds_is_offered(ask: Ask, tmp_path: Path) -> None:
    (tmp_path / "own/method").mkdir(parents=True)
    (tmp_path / "own/method/mine.yaml").write_text("defaults: [edsc, _self_]\nname: mine\n")
    for verb in ("run", "plan"):
        assert list(ask(f"{verb} --config-dir {tmp_path}/own method=mi")) == ["method=mine"]


def test_a_choice_has_an_explanation(ask: Ask) -> None:
    methods = ask("run method=")
    assert methods.keys() > {"method=adaptive", "method=bmm"}
    assert all(methods.values()), methods


def test_what_packages_bring_is_offered(shell: Shell, tmp_path: Path) -> None:
    root = tmp_path / "site"
    (root / "theirs/conf/method").mkdir(parents=True)
    (root / "theirs/__init__.py").touch()
    (root / "theirs/conf/method/theirs.yaml").write_text("# A method of theirs.\nname: theirs\nalgorithm: theirs\n")
    (root / "theirs-1.0.dist-info").mkdir()
    (root / "theirs-1.0.dist-info/METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (root / "theirs-1.0.dist-info/entry_points.txt").write_text("[nrsfm.methods]\ntheirs = theirs:No\n")
    line = variables("nrsfm run method=th") | {"_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "answer")}
    shell(PYTHONPATH=os.pathsep.join([str(root), str(ROOT)]), **line)
    assert (tmp_path / "answer").read_text() == "method=theirs\tA method of theirs."


@pytest.mark.parametrize(
    ("line", "heavy"),
    [
        ("", {"numpy", "hydra", "pandas", "mlflow", "rich", "sklearn", "yaml"}),
        ("run --", {"numpy", "hydra", "pandas", "mlflow", "rich", "sklearn", "yaml"}),
        ("data get ", {"numpy", "hydra", "pandas", "mlflow", "rich", "sklearn", "yaml"}),
        ("run dataset=", {"numpy", "pandas", "mlflow", "sklearn"}),
    ],
)
def test_an_answer_loads_nothing_heavy(line: str, heavy: set[str]) -> None:
    code = (
        "import sys; from nrsfm.harness.cli.completion import Finder; Finder().answer(exit_method=str)\n"
        f"print({heavy} & sys.modules.keys(), file=sys.stderr); sys.exit(bool({heavy} & sys.modules.keys()))"
    )
    environment = os.environ | variables(f"nrsfm {line}") | {"_ARGCOMPLETE_STDOUT_FILENAME": os.devnull}
    done = subprocess.run([sys.executable, "-c", code], env=environment, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_other_shells_are_refused(nrsfm: Shell) -> None:
    done = nrsfm("completion", "tcsh")
    assert done.returncode == 3
    assert "bash" in done.stderr


# Real shells


@pytest.fixture
def command(environment: dict[str, str], tmp_path: Path) -> dict[str, str]:
    """An environment in which ``nrsfm`` is this checkout."""
    place = tmp_path / "bin"
    place.mkdir()
    (place / "nrsfm").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m nrsfm "$@"\n')
    (place / "nrsfm").chmod(0o755)
    quiet = {"TERM": "dumb", "HOME": str(tmp_path), "PS1": "$ ", "COLUMNS": "400", "LC_ALL": "C.UTF-8"}
    return environment | quiet | {"PATH": f"{place}{os.pathsep}{environment['PATH']}"}


#: How each is started, and what binds Ctrl-X w to printing the line that is being edited.
START = {
    "bash": ("bash --norc --noprofile -i", r"""bind -x '"\C-xw": printf "LINE<%s>\n" "$READLINE_LINE"'"""),
    "zsh": (
        "zsh -f -i",
        """say() { print -r -- "LINE<$BUFFER>" }; zle -N say; bindkey "^Xw" say; unsetopt prompt_cr""",
    ),
}


class Terminal:
    """An interactive shell that completes."""

    def __init__(self, shell: str, environment: dict[str, str], cwd: Path) -> None:
        words, prepare = START[shell]
        pid, self._handle = pty.fork()
        if pid == 0:
            os.chdir(cwd)
            os.execvpe(shell, words.split(), environment)
        self._send(f"{prepare}\n")
        self._send(f'eval "$(nrsfm completion {shell})"; echo "RE""ADY"\n')
        self._until("READY")

    def complete(self, typed: str) -> str:
        """The line after a tab."""
        self._send(f"{typed}\t")
        time.sleep(0.05)
        self._send("\x18w")
        line = re.findall(r"LINE<(.*)>", self._until(r"LINE<.*>\r?\n"))[-1]
        self._send("\x15")
        return str(line)

    def close(self) -> None:
        os.close(self._handle)

    def _send(self, text: str) -> None:
        os.write(self._handle, text.encode())

    def _until(self, pattern: str, seconds: float = 60) -> str:
        seen, end = "", time.monotonic() + seconds
        while not re.search(pattern, seen):
            left = end - time.monotonic()
            assert left > 0, seen
            if select.select([self._handle], [], [], left)[0]:
                seen += os.read(self._handle, 65536).decode(errors="replace")
        return seen


@pytest.fixture(params=["bash", pytest.param("zsh", marks=pytest.mark.slow)])
def terminal(request: pytest.FixtureRequest, command: dict[str, str], tmp_path: Path) -> Iterator[Terminal]:
    if shutil.which(request.param) is None:
        pytest.skip(f"{request.param} is not installed")
    made = Terminal(request.param, command, tmp_path)
    yield made
    made.close()


def test_a_tab_in_a_terminal(terminal: Terminal, tmp_path: Path) -> None:
    (tmp_path / "a folder").mkdir()
    assert terminal.complete("nrsfm rep") == "nrsfm report "
    assert terminal.complete("nrsfm compare --str") == "nrsfm compare --strict "
    assert terminal.complete("nrsfm run dataset=shark_y") == "nrsfm run dataset=shark_yoga "
    assert terminal.complete("nrsfm run noise.l") == "nrsfm run noise.level="
    assert terminal.complete("true; nrsfm plan experiment=tabl") == "true; nrsfm plan experiment=table"
    assert terminal.complete("nrsfm run method=edsc,bmm_l") == "nrsfm run method=edsc,bmm_lrr3d "
    assert terminal.complete("nrsfm report --folder a").rstrip("/ ") == "nrsfm report --folder a\\ folder"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
def test_fish_completes(command: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()

    def complete(line: str) -> list[str]:
        code = f"nrsfm completion fish | source; complete --do-complete '{line}'"
        done = subprocess.run(
            ["fish", "--no-config", "-c", code], env=command, cwd=tmp_path, capture_output=True, text=True, timeout=60
        )
        assert done.stderr == ""
        return [each.partition("\t")[0] for each in done.stdout.splitlines()]

    assert complete("nrsfm rep") == ["report"]
    assert complete("nrsfm run dataset=shark_y") == ["dataset=shark_yoga"]
    assert complete("nrsfm report --folder fol") == ["folder/"]


@pytest.mark.parametrize("shell", SHELLS)
def test_scripts_are_of_their_shell(shell: str, nrsfm: Shell, tmp_path: Path) -> None:
    script = tmp_path / "script"
    script.write_text(nrsfm("completion", shell).stdout)
    assert "_ARGCOMPLETE" in script.read_text()
    if shutil.which(shell):
        subprocess.run([shell, "-n", str(script)], check=True)
