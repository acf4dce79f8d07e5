"""Completion: the answers, and what a tab does in a real bash, zsh and fish."""

from __future__ import annotations

import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from nrsfm.harness.cli.completion import SHELLS, candidates
from nrsfm.harness.cli.verbs import VERBS
from tests.shell import ROOT, Shell


def after(line: str) -> list[str]:
    return list(candidates(f"nrsfm {line}"))


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("", [*VERBS]),
        ("re", ["report"]),
        ("--v", ["--version"]),
        ("report --f", ["--folder", "--figures"]),
        ("report --quiet table1 --c", ["--claims"]),
        ("report --folder ", [":files"]),
        ("report table1 --folder out conv", ["convergence"]),
        ("bless ", ["quick", "tables"]),
        ("solve ", [":files"]),
        ("solve tracks.npz --method ours_ap", ["ours_apart"]),
        ("solve tracks.npz --cameras ", ["auto", "known", "estimated"]),
        ("solve tracks.npz method.max_", ["method.max_iter="]),
        ("bless quick comp", ["compare.", "compare="]),
        ("data ", ["list", "get", "verify", "where"]),
        ("data get dri", ["drink", "drink.mat"]),
        ("list d", ["datasets"]),
        ("new ", ["method", "dataset"]),
        ("new method mine ", []),
        ("run --cfg ", ["job", "hydra", "all"]),
        ("run noise.l", ["noise.level="]),
        ("run noise=", ["noise=gaussian"]),
        ("run rerun=", ["rerun=none", "rerun=failed", "rerun=stale", "rerun=all"]),
        ("run limits.seconds=", ["limits.seconds=3600"]),
        ("run dataset=dance_yoga method=edsc,ou", [*(f"method=edsc,{n}" for n in ("ours", "ours_apart"))]),
        ("run method=edsc,edsc_r", ["method=edsc,edsc_raw"]),
        ("run -m exp", ["experiment="]),
        ("plan experiment=dense", [f"experiment=dense{end}" for end in ("", "_full", "_full_99")]),
        ("run method=edsc method.clusterer.dim", ["method.clusterer.dimension="]),
        ("run method=a,b dataset=[ method=no method.l", ["method.l1."]),  # what cannot be used is passed over
        ("run hydra/launcher=jo", ["hydra/launcher=joblib"]),
        ("run 'cameras=", ["cameras=estimated", "cameras=known"]),
        ("solve ", [":files"]),
        ("solve tracks.npz ", ["cameras.", "limits.", "method.", "threads="]),
        ("solve tracks.npz --method bmm_", ["bmm_lrr3d", "bmm_ssc3d", "bmm_ssc3d_k6", "bmm_ssc3d_share70"]),
        ("solve tracks.npz --cameras ", ["auto", "known", "estimated"]),
        ("frobnicate ", []),
    ],
)
def test_what_may_stand_next(line: str, offered: list[str]) -> None:
    assert set(offered) <= set(after(line)) if line.endswith("ou") else after(line) == offered


def test_a_variable_before_the_command_is_no_verb() -> None:
    assert list(candidates("NRSFM_OUTPUT=there nrsfm doc")) == ["doctor"]


def test_groups_stand_where_they_can_be_given() -> None:
    plain, added, removed = after("run "), after("run +"), after("run ~")
    assert {"dataset=", "method=", "dataset.", "experiment="} <= set(plain)
    assert "part=" not in plain
    assert not {"+experiment=", "experiment=", "+dataset=", "+part="} & set(added)
    assert "~noise" in removed


def test_paths_are_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lab").mkdir()
    (tmp_path / "letter.txt").touch()
    monkeypatch.chdir(tmp_path)
    assert after("run output=./l") == ["output=./lab/", "output=./letter.txt"]


def test_a_choice_says_what_it_is() -> None:
    found = candidates("nrsfm run method=")
    assert found.keys() > {"method=ours", "method=bmm"}
    assert all(found.values()), found


def test_what_packages_bring_is_offered(shell: Shell, tmp_path: Path) -> None:
    root = tmp_path / "site"
    (root / "theirs/conf/method").mkdir(parents=True)
    (root / "theirs/__init__.py").touch()
    (root / "theirs/conf/method/theirs.yaml").write_text("# A method of theirs.\nname: theirs\nalgorithm: theirs\n")
    (root / "theirs-1.0.dist-info").mkdir()
    (root / "theirs-1.0.dist-info/METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (root / "theirs-1.0.dist-info/entry_points.txt").write_text("[nrsfm.methods]\ntheirs = theirs:No\n")
    done = shell("completion", "--query", "nrsfm run method=th", PYTHONPATH=os.pathsep.join([str(root), str(ROOT)]))
    assert done.stdout == "method=theirs\tA method of theirs.\n"


def test_verbs_and_options_load_nothing_heavy() -> None:
    code = (
        "import sys; from nrsfm.harness.cli.main import main\n"
        "for line in ('nrsfm ', 'nrsfm run --', 'nrsfm report --f', 'nrsfm data get '):\n"
        "    main(['completion', '--query', line])\n"
        "heavy = {'numpy', 'hydra', 'pandas', 'mlflow', 'rich', 'sklearn', 'yaml'} & sys.modules.keys()\n"
        "print(heavy, file=sys.stderr); sys.exit(bool(heavy))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr


def test_overrides_load_no_method() -> None:
    code = (
        "import sys; from nrsfm.harness.cli.main import main; main(['completion', '--query', 'nrsfm run dataset='])\n"
        "heavy = {'numpy', 'pandas', 'mlflow', 'sklearn'} & sys.modules.keys()\n"
        "print(heavy, file=sys.stderr); sys.exit(bool(heavy))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
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
    assert "completion --query" in script.read_text()
    if shutil.which(shell):
        subprocess.run([shell, "-n", str(script)], check=True)
