"""Commands, Python snippets and configuration keys in the README and the pages of the site work."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import yaml
from hydra import compose
from hydra._internal.utils import get_args_parser
from scipy.io import savemat

from nrsfm.datasets.generated import procedural
from nrsfm.harness.cli.verbs import VERBS, module
from nrsfm.harness.config.compose import configurations
from nrsfm.harness.config.settings import read
from nrsfm.harness.config.spans import expand, spanned
from nrsfm.harness.record.folder import write_atomically
from nrsfm.methods.registry import build_method
from tests.checkout import copy_checkout
from tests.documents.documents import (
    CONF,
    PAGES,
    PROGRAMS,
    ROOT,
    RULES,
    RUN,
    SHOWN,
    Command,
    blocks,
    commands,
    mentions,
    rule,
    snippets,
)
from tests.fuzz.files import record
from tests.shell import Shell

EVERY = [command for page in PAGES for command in commands(page)]
ONCE = list({command.text: command for command in EVERY}.values())
#: Choices that earlier commands of the same page create.
OWN = ("my_method", "my_scenes", "rigid_depth", "breathing_clouds")


def test_every_command_has_a_rule_and_every_rule_a_command() -> None:
    assert not [str(command) for command in EVERY if rule(command) is None]
    used = {rule(command) for command in EVERY}
    assert not [own.pattern for own in RULES if own not in used]


def test_verbs_that_the_prose_names_are_there() -> None:
    for command in (command for page in PAGES for command in mentions(page)):
        assert command.words[1] in (*VERBS, "VERB"), command


def test_every_block_is_of_a_known_kind() -> None:
    for page in PAGES:
        for block in blocks((ROOT / page).read_text(encoding="utf-8")):
            assert block.kind in ("prose", "indented", *RUN, *SHOWN), f"{page}:{block.line}: {block.kind}"


def test_every_command_starts_with_a_known_program() -> None:
    for command in EVERY:
        assert command.words[0] in PROGRAMS, command


@pytest.fixture(scope="module")
def tree() -> Iterator[None]:
    with configurations():
        yield


@pytest.mark.parametrize("command", ONCE, ids=lambda command: command.text)
def test_command_is_composed(command: Command, tree: None) -> None:
    """Its options are known, its configuration is composed, its methods are built, its files exist."""
    program, *words = command.words
    if program == "make":
        assert re.search(rf"^{words[0]}:", (ROOT / "Makefile").read_text(), re.MULTILINE), command
    elif program == "nrsfm":
        assert words[0] in VERBS, command
        _compose(words[0], words[1:])
    elif program == "eval":
        assert words[0].startswith("$(nrsfm completion "), command
    else:
        assert program in ("git", "pip", "pytest", "python", "createuser", "createdb", "export", "mlflow"), command


def _compose(verb: str, words: list[str]) -> None:
    if verb == "run":
        asked, unknown = get_args_parser().parse_known_args(words)
        assert not unknown
        overrides = asked.overrides
        if "hydra/launcher=ray" in overrides and not find_spec("hydra_plugins.hydra_ray_launcher"):
            pytest.skip("the ray extra is absent")
    else:
        parser = module(verb).command_line()
        given = parser.parse_args(words) if verb == "data" else parser.parse_intermixed_args(words)
        overrides = getattr(given, "overrides", getattr(given, "words", []))
        if verb == "solve":
            overrides.insert(0, f"method={given.method}")
    overrides = [word for word in overrides if "=" in word]
    names = [word for word in words if verb == "report" and re.fullmatch(r"\w+", word) and "." not in word]
    if verb in ("list", "new", "sync", "ui", "doctor", "completion") or any(own in " ".join(words) for own in OWN):
        return
    for own in [[f"experiment={name}"] for name in names if (CONF / f"experiment/{name}.yaml").exists()] or [[]]:
        _make((*own, *overrides))


@cache
def _make(overrides: tuple[str, ...]) -> None:
    """Build the first and the last trial that the overrides span."""
    with configurations():
        jobs = spanned(overrides)
        for job in {tuple(jobs[0]), tuple(jobs[-1])}:
            trial, _ = read(compose("config", overrides=list(job)))
            build_method({key: value for key, value in trial.method.items() if key != "name"})


QUICK = [command for command in ONCE if (found := rule(command)) and found.quick]


def write_tracks(folder: Path) -> None:
    """Write the tracks.npz, tracks.mat and tracks.csv that pages name."""
    scene = procedural.load_scene(["person", "face"], 15, 40, 0, name="tracks", placement="paper")
    assert scene.labels is not None
    np.savez(folder / "tracks.npz", tracks=scene.tracks, labels=scene.labels)
    savemat(folder / "tracks.mat", {"W": scene.tracks.reshape(-1, scene.n_points)})
    rows = [
        f"{f},{p},{x},{y}"
        for f, (xs, ys) in enumerate(scene.tracks)
        for p, (x, y) in enumerate(zip(xs, ys, strict=True))
    ]
    (folder / "tracks.csv").write_text("\n".join(["frame,track,x,y", *rows]) + "\n")


def test_quick_commands_run(nrsfm: Shell, tmp_path: Path) -> None:
    write_tracks(tmp_path)
    for command in QUICK:
        found = rule(command)
        assert found
        done = nrsfm(*command.words[1:], *found.part.split())
        assert done.returncode in found.codes, (str(command), done.stderr)


@pytest.mark.parametrize("page", [page for page in PAGES if snippets(page)])
def test_python_runs(page: str, environment: dict[str, str], tmp_path: Path) -> None:
    """A page's snippets run in one process, so later ones see earlier names. Choices that `new` writes are replaced."""
    write_tracks(tmp_path)
    write_atomically(tmp_path / "outputs/trials/0123456789abcdef/result.json", lambda file: file.write(record()))
    text = "\n\n".join(snippets(page)).replace("my_scenes dataset.points=40", "procedural dataset.points=8")
    (tmp_path / "page.py").write_text(text.replace("method=my_method", "method=edsc"))
    done = subprocess.run(
        [sys.executable, "page.py"],
        env=environment | {"NRSFM_OUTPUT": str(tmp_path / "outputs")},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_keys_that_the_pages_name_are_there() -> None:
    """Keys and choices between backquotes exist in conf/."""
    known, choices = _keys()
    for page in PAGES:
        for block in blocks((ROOT / page).read_text(encoding="utf-8")):
            for span in re.findall(r"(?<!`)`([^`\n]+)`(?!`)", "\n".join(block.lines) if block.kind == "prose" else ""):
                for word in span.replace("'", "").split():
                    if word.endswith((".csv", ".json", ".npz", ".yaml")):
                        continue
                    key, given, value = word.lstrip("+").partition("=")
                    group = key.partition(".")[0]
                    if given and re.fullmatch(r"[\w./]+", key):
                        assert key in known or key in choices or key.startswith("hydra"), f"{page}: {span}"
                        if key in choices and re.fullmatch(r"[a-z0-9_,]+", value):
                            assert set(value.split(",")) <= choices[key] | set(OWN), f"{page}: {span}"
                    elif "." in key and group in choices and group != "datasets" and re.fullmatch(r"[a-z_0-9.]+", key):
                        assert key in known, f"{page}: {span}"


def _keys() -> tuple[set[str], dict[str, set[str]]]:
    """Every key of the configuration by its full name, and the choices of each group."""
    choices: dict[str, set[str]] = {}
    known = _flat("", yaml.safe_load((CONF / "config.yaml").read_text()))
    parts = {}
    for path in sorted(CONF.glob("*/*.yaml")):
        group = path.parent.name
        choices.setdefault(group, set()).add(path.stem)
        own = _flat("", yaml.safe_load(path.read_text()) or {})
        if group == "part":
            parts[path.stem] = own
        else:
            known |= {f"{group}.{key}" for key in own}
    for own in parts.values():
        known |= {f"method.{place}{key}" for place in ("", "clusterer.", "reconstructor.") for key in own}
    return known, choices


def _flat(prefix: str, tree: dict[str, object]) -> set[str]:
    found = set()
    for key, value in tree.items():
        found.add(f"{prefix}{key}")
        if isinstance(value, dict):
            found |= _flat(f"{prefix}{key}.", value)
    return found


def test_modules_that_the_pages_name_exist() -> None:
    """Paths of modules in this repository, between backquotes; those of a page's own commands excepted."""
    for page in PAGES:
        text = (ROOT / page).read_text(encoding="utf-8")
        for path in re.findall(r"`((?:conf|datasets|harness|methods|reports|tests)/[\w/.-]*)`", text):
            assert (ROOT / path).exists() or any(name in path for name in OWN), f"{page}: {path}"


def test_extras_that_the_pages_name_are_there() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for page in PAGES:
        text = (ROOT / page).read_text(encoding="utf-8")
        for name in re.findall(r"the extra `(\w+)`", text) + re.findall(r"\.\[(\w+)\]", text):
            assert name in extras, f"{page}: {name}"


COUNTED = [
    (page, *found.groups())
    for page in PAGES
    for found in re.finditer(r"^\s*(nrsfm run \S.*?)\s+# (\d+) trials", (ROOT / page).read_text(), re.MULTILINE)
]


@pytest.mark.slow
@pytest.mark.parametrize(("page", "text", "number"), COUNTED)
def test_numbers_of_trials_are_right(page: str, text: str, number: str) -> None:
    assert len(expand(Command(page, 0, text).words[2:])) == int(number)


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)])
def test_commands_run(page: str, environment: dict[str, str], tmp_path: Path) -> None:
    """A page's commands, in its order, in a shell at the root of a copy of this checkout.

    ``nrsfm`` and ``pytest`` are those of this interpreter; ``pip`` installs into a folder of the test's own.
    """
    root, programs, site = tmp_path / "checkout", tmp_path / "bin", tmp_path / "site"
    copy_checkout(root)
    programs.mkdir()
    write_tracks(root)
    pip = f"pip install --quiet --no-deps --no-build-isolation --no-index --target {site}"
    for name, words in (("nrsfm", 'nrsfm "$@"'), ("pytest", 'pytest -n0 -p no:cacheprovider "$@"'), ("pip", pip)):
        script = programs / name
        last = ' "./${@: -1}"' if name == "pip" else ""  # a folder, which pip takes for a name without the slash
        script.write_text(f"#!/bin/bash\nexec {sys.executable} -m {words}{last}\n")
        script.chmod(0o755)
    real = os.environ.get("NRSFM_DATA")
    variables = environment | {
        "PATH": f"{programs}{os.pathsep}{environment['PATH']}",
        "PYTHONPATH": os.pathsep.join(map(str, (root / "src", root, site))),
        "NRSFM_DATA": real or environment["NRSFM_DATA"],
    }
    for command in commands(page):
        found = rule(command)
        assert found, command
        if found.never or (found.data and not real):
            continue
        text = f"{command.text} {found.part}"
        done = subprocess.run(
            ["bash", "-c", text], env=variables, cwd=root, capture_output=True, text=True, check=False
        )
        assert done.returncode in found.codes, (text, done.stdout[-2000:], done.stderr[-2000:])
        assert "Traceback" not in done.stderr, (text, done.stderr)
