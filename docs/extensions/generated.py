"""Pages made from the code while the site is built: the text that replaces <!-- generated: NAME -->.

``configuration``: every file and key of conf/ with its default and comment. ``commands``: the help of every verb.
``api PACKAGE``: a section for every module of a package, from the docstrings.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import os
import pkgutil
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest import mock

import yaml
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

ROOT = Path(__file__).resolve().parents[2]
CONF = ROOT / "src/nrsfm/conf"
MARK = re.compile(r"^<!-- generated: (\w+)(?: (\w+))? -->$", re.MULTILINE)
LONGEST = 110  # of a value, in characters
GROUPS = {
    "dataset": "The scene.",
    "cameras": "Where the cameras come from.",
    "noise": "Noise on the tracks.",
    "gaps": "Observations that are dropped.",
    "corruption": "Faults of a tracker that are put into the tracks.",
    "observations": "What is taken out of the tracks before a method sees them.",
    "method": "The method that reconstructs and clusters.",
    "part": "What methods are composed of: `method.clusterer` and `method.reconstructor` of a pipeline.",
    "experiment": "Named sweeps: `experiment=NAME`.",
    "tracking": "Where MLflow keeps the runs.",
    "compare": "What `nrsfm compare` tolerates.",
}


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", _read)
    return {"version": "1", "parallel_read_safe": True}


def _read(app: Sphinx, page: str, source: list[str]) -> None:
    makers: dict[str, Callable[..., str]] = {"configuration": configuration, "commands": commands, "api": api}
    source[0] = MARK.sub(lambda mark: makers[mark[1]](*filter(None, [mark[2]])), source[0])
    sources = (*CONF.rglob("*.yaml"), *(ROOT / "src/nrsfm/harness/cli").glob("*.py"))
    for path in sources if page in makers else ():
        app.env.note_dependency(str(path))


@dataclass(frozen=True)
class Key:
    """A key of a configuration file: its dotted name, its value as it is written, and the comment behind it."""

    name: str
    value: str
    comment: str


def configuration() -> str:
    """A section for config.yaml and for each group, with a table for each file."""
    parts = ["## config.yaml", "", *_file(CONF / "config.yaml")]
    groups = {path.name for path in CONF.iterdir() if path.is_dir() and path.name != "__pycache__"}
    if groups != set(GROUPS):
        raise ExtensionError(f"docs/extensions/generated.py describes {set(GROUPS)}, and conf/ holds {groups}")
    for group, text in GROUPS.items():
        parts += [f"## {group}", "", text, ""]
        for path in sorted((CONF / group).glob("*.yaml")):
            choice = f"experiment={path.stem}" if group == "experiment" else f"{group}={path.stem}"
            parts += [f"### `{choice}`", "", *_file(path)]
    return "\n".join(parts)


def _file(path: Path) -> list[str]:
    about, keys = described(path)
    table = [f"| `{key.name}` | {_code(key.value)} | {_cell(key.comment)} |" for key in keys]
    return [*about, "", *(["| Key | Default | Meaning |", "|---|---|---|", *table, ""] if table else [])]


def described(path: Path) -> tuple[list[str], list[Key]]:
    """The comment at the head of a configuration file, as Markdown, and its keys."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    head = []
    for line in lines:
        if not line.startswith("#"):
            break
        if not line.startswith("# @package"):
            head.append(line[1:])
    shown = [line for line in head if re.match(r" {2,}\w| nrsfm ", line)]
    about = [_cell(line.strip()) for line in head if line not in shown]
    if shown:
        about += ["", "```text", *(line.strip() for line in shown), "```"]
    tree = yaml.compose(text)
    keys = []
    if isinstance(tree, yaml.MappingNode):
        based = [item for item in yaml.safe_load(text).get("defaults", []) if item != "_self_"]
        if based:
            about += ["", "Composed of " + ", ".join(f"`{_choice(item)}`" for item in based) + "."]
        hints = _hints(path)
        for name, value, number in _leaves(tree):
            written = " ".join(text[value.start_mark.index : value.end_mark.index].split())
            end = value.end_mark if value.end_mark.line == value.start_mark.line else value.start_mark
            behind = re.search(r"#\s*(.*)", lines[end.line][end.column :])
            above = lines[number - 1].strip() if number > len(head) + text.startswith("# @package") else ""
            comment = behind[1] if behind else above.lstrip("# ") if above.startswith("#") else hints.get(name, "")
            keys.append(Key(name, written, comment))
    return about, keys


def _hints(path: Path) -> dict[str, str]:
    """Descriptions of keys from the class behind a file and from the files that it is composed of."""
    hints: dict[str, str] = {}
    for item in yaml.safe_load(path.read_text(encoding="utf-8")).get("defaults", []):
        if not isinstance(item, str) or item == "_self_":
            continue
        name, _, place = item.partition("@")
        file = CONF / f"{name.lstrip('/')}.yaml" if name.startswith("/") else path.with_name(f"{name}.yaml")
        prefix = "" if place in ("", "_here_") else f"{place}."
        inner = _hints(file) | {key.name: key.comment for key in described(file)[1] if key.comment}
        hints |= {f"{prefix}{key}": comment for key, comment in inner.items()}
    return hints | _docstring(yaml.safe_load(path.read_text(encoding="utf-8")))


def _choice(item: str | dict[str, str]) -> str:
    return item if isinstance(item, str) else ": ".join(str(word) for word in next(iter(item.items())))


def _leaves(node: yaml.MappingNode, prefix: str = "") -> Iterator[tuple[str, yaml.Node, int]]:
    for key, value in node.value:
        name = f"{prefix}{key.value}"
        if name == "defaults":
            continue
        parts = ("clusterer", "reconstructor")
        if isinstance(value, yaml.MappingNode) and (name in parts or not value.flow_style):
            yield from _leaves(value, f"{name}.")
        else:
            yield name, value, key.start_mark.line


def _docstring(settings: dict[str, Any]) -> dict[str, str]:
    """Hyper-parameters of a method and their descriptions, from the docstring of its class."""
    from nrsfm.methods.registry import algorithm

    if "algorithm" not in settings:
        return {}
    found: dict[str, str] = {}
    names: list[str] = []
    doc = inspect.getdoc(algorithm(settings["algorithm"])) or ""
    for line in doc.partition("Parameters\n")[2].partition("\n\n")[0].splitlines()[1:]:
        if not line.startswith(" "):
            names = [name.strip() for name in line.partition(" : ")[0].split(",")]
        else:
            found |= {name: f"{found.get(name, '')} {line.strip()}".strip() for name in names}
    return found


def _code(value: str) -> str:
    if len(value) > LONGEST:
        words = value.lstrip(">|-\n ").split(",")
        value = f"{','.join(words[:3])}, ... ({len(words)} values)"
    return f"`{value}`".replace("|", "\\|") if value else ""


def _cell(text: str) -> str:
    """Text of a comment as Markdown: what looks like a key or a command is code."""
    text = re.sub(r"(?<![\w`'])((?:\w+\.)*\w+=[^\s,;:]*[^\s,;:.)])", r"`\1`", text)
    text = re.sub(r"'(nrsfm [^']+)'", r"`\1`", text)
    return re.sub(r"(?<!`)([|<>*_])(?!`)", r"\\\1", text) if "`" not in text else text.replace("|", "\\|")


def commands() -> str:
    """The help of the command line and of every verb."""
    from nrsfm.harness.cli.verbs import VERBS

    parts = ["## nrsfm", "", _help([])]
    for verb in VERBS:
        parts += [f"## nrsfm {verb}", "", _help([verb])]
        if verb == "data":
            for inner in ("list", "get", "verify", "where"):
                parts += [f"### nrsfm data {inner}", "", _help(["data", inner])]
    return "\n".join(parts)


def _help(words: list[str]) -> str:
    from nrsfm.harness.cli.main import main

    output = io.StringIO()
    wide = mock.patch.dict(os.environ, {"COLUMNS": "100"})
    with wide, contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
        main([*words, "--help"])
    return f"```text\n{output.getvalue().strip()}\n```\n"


def api(package: str) -> str:
    """A section for each module of a package and of the packages in it."""
    parts = []
    root = import_module(f"nrsfm.{package}")
    for module in pkgutil.walk_packages(root.__path__, f"{root.__name__}."):
        last = module.name.rpartition(".")[2]
        if last == "__main__" or (module.ispkg and not _defines(module.name)):
            continue
        parts += [f"## {module.name}", "", "```{eval-rst}", f".. automodule:: {module.name}", "```", ""]
    return "\n".join(parts)


def _defines(package: str) -> bool:
    """Whether a package defines something of its own, and does not only hold modules."""
    things = vars(import_module(package)).values()
    return any(getattr(thing, "__module__", None) == package for thing in things)
