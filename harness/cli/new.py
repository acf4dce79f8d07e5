"""The verb ``new``: write the module, the configuration and the test of a new method or dataset."""

from __future__ import annotations

import keyword
import re
import tomllib
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from nrsfm import datasets, methods
from nrsfm.harness.cli.parser import Parser
from nrsfm.harness.record.errors import UsageError

NAME = r"[a-z][a-z0-9_]{0,29}"

#: Kind -> its entry point group, and the folder of a checkout that holds its modules.
KINDS = {"method": (methods.ENTRY_POINTS, "methods"), "dataset": (datasets.ENTRY_POINTS, "datasets")}


def main(argv: Sequence[str]) -> int:
    """Write the files and print what to do next."""
    options = command_line().read(argv)
    from nrsfm.harness.record.environment import checkout

    _check_name(options.kind, options.name)
    root = checkout()
    if options.package is None and root is not None and Path.cwd().is_relative_to(root):
        texts = _in_checkout(root, options.kind, options.name)
        after = ""
    else:
        folder = options.package or Path(f"nrsfm-{options.name.replace('_', '-')}")
        texts = _in_package(folder, options.kind, options.name)
        after = f"  pip install --editable {folder}\n"
    _write(texts)
    tests = next(path for path in texts if path.name == f"test_{options.name}.py")
    print("\n".join(f"wrote {_short(path)}" for path in texts))
    print(f"{after}  pytest -n0 {_short(tests)}\n  nrsfm run experiment=quick {options.kind}={options.name}")
    return 0


def _check_name(kind: str, name: str) -> None:
    """Raise UsageError unless the name can be a module's and is free."""
    from nrsfm.datasets.registry import SOURCES
    from nrsfm.harness.config.plugins import choices, installed
    from nrsfm.methods.registry import ALGORITHMS

    if not re.fullmatch(NAME, name) or keyword.iskeyword(name) or _is_imported(kind, name):
        raise UsageError(
            f"{name!r} cannot be a name, wanted up to 30 lower case letters, digits and _, a letter first, no word of "
            "Python or of nrsfm.methods.base"
        )
    group, folder = KINDS[kind]
    own = ALGORITHMS if kind == "method" else SOURCES
    declared = any(entry.group == group and entry.name == name for entry in installed())
    if name in own or declared or name in choices(kind) or find_spec(f"nrsfm.{folder}.{name}"):
        raise UsageError(f"there is a {kind} {name} already; choose another name ('nrsfm list' names them)")


def _is_imported(kind: str, name: str) -> bool:
    """Whether a method's class would have the name of something that its module imports."""
    from nrsfm.methods import base

    return kind == "method" and hasattr(base, _title(name))


def _in_checkout(root: Path, kind: str, name: str) -> dict[Path, str]:
    folder = KINDS[kind][1]
    words = {"name": name, "title": _title(name), "module": f"nrsfm.{folder}.{name}", "checkout": True}
    return {
        root / folder / f"{name}.py": _render(f"{kind}.py", words),
        root / "conf" / kind / f"{name}.yaml": _render(f"{kind}.yaml", words),
        root / "tests" / folder / f"test_{name}.py": _render(f"test_{kind}.py", words),
    }


def _in_package(folder: Path, kind: str, name: str) -> dict[Path, str]:
    """The files of a package, new or existing, with the entry point in its pyproject.toml."""
    project = folder.resolve().name
    package = re.sub(r"[-. ]+", "_", project.lower())
    if not re.fullmatch(r"[a-z][a-z0-9_]*", package) or keyword.iskeyword(package):
        raise UsageError(f"--package {folder}: {project!r} cannot be a package's name; start it with a letter")
    spec = find_spec(package)
    places = {Path(place).resolve() for place in spec.submodule_search_locations or ()} if spec else set()
    if spec and (folder / package).resolve() not in places:
        raise UsageError(f"--package {folder}: there is a module {package} already, {spec.origin}; name another folder")
    words = {"name": name, "title": _title(name), "module": f"{package}.{name}", "project": project, "package": package}
    target = words["module"] + (f":{words['title']}" if kind == "method" else "")
    about = folder / "pyproject.toml"
    before = about.read_text(encoding="utf-8") if about.is_file() else _render("pyproject.toml", words)
    init = folder / package / "__init__.py"
    return {
        **({} if init.is_file() else {init: ""}),
        folder / package / f"{name}.py": _render(f"{kind}.py", words),
        folder / package / "conf" / kind / f"{name}.yaml": _render(f"{kind}.yaml", words),
        folder / "tests" / f"test_{name}.py": _render(f"test_{kind}.py", words),
        about: _declare(about, before, KINDS[kind][0], name, target),
    }


def _declare(path: Path, text: str, group: str, name: str, target: str) -> str:
    """A pyproject.toml with one more entry point; raises UsageError if adding a line does not do it."""
    header, line = f'[project.entry-points."{group}"]', f'{name} = "{target}"'
    if header in text.splitlines():
        text = text.replace(header + "\n", f"{header}\n{line}\n", 1)
    else:
        text = f"{text.rstrip()}\n\n{header}\n{line}\n"
    try:
        declared = tomllib.loads(text)["project"]["entry-points"][group][name]
    except (tomllib.TOMLDecodeError, KeyError, TypeError):
        declared = None
    if declared != target:
        raise UsageError(f"{path}: cannot add {line} to {header}; add it by hand and name another package")
    return text


def _write(texts: Mapping[Path, str]) -> None:
    """Write all files, or none if one exists already; only pyproject.toml is overwritten."""
    for path in texts:
        if path.name != "pyproject.toml" and (path.exists() or path.is_symlink()):
            raise UsageError(f"{_short(path)} is there already and is not overwritten; choose another name")
    for path, text in texts.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def _render(template: str, words: Mapping[str, object]) -> str:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("nrsfm.harness.cli"),
        undefined=jinja2.StrictUndefined,
        autoescape=False,  # Python and YAML, of checked names
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(f"{template}.j2").render({"checkout": False} | dict(words))


def _title(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _short(path: Path) -> Path:
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def command_line() -> Parser:
    parser = Parser(
        "nrsfm new",
        "Write a method or a dataset of your own. Its module, configuration and test run at once. "
        "In a checkout of nrsfm they go into its folders, elsewhere into a package to install.",
        """\
nrsfm new method my_method  # then: nrsfm run experiment=quick method=my_method
nrsfm new dataset my_scenes
nrsfm new method other --package my-package  # into a package, made if it is missing""",
        "exit codes: 0 written, 3 usage: a name that is taken or cannot be one, a file that is there already",
    )
    parser.add_argument("kind", choices=["method", "dataset"], help="what to write")
    parser.add_argument("name", help="lower case letters, digits and _")
    parser.add_argument("--package", type=Path, metavar="FOLDER", help="write into this package, made if it is missing")
    return parser
