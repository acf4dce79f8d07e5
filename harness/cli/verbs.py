"""The verbs of the command line: a line for each, and a module of the same name beside this one.

A verb's module defines ``command_line()``, its parser, and ``main(argv)``, which returns the exit code. It imports at
the top what its parser needs and nothing slow, so that help and completion are quick.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import ModuleType

#: Verb -> how its command line looks, and what it does.
VERBS: Mapping[str, tuple[str, str]] = {
    "run": ("[-m] [OVERRIDES]", "run one trial, a sweep, or an experiment (a Hydra application)"),
    "solve": ("FILE --bodies N", "reconstruct tracks of your own, of any tracker, and tell the bodies apart"),
    "plan": ("[OVERRIDES]", "show what run would do: trials done, missing and failed, time and memory"),
    "report": ("[TABLES] [OVERRIDES]", "rebuild the paper's tables from the tracker; runs no method"),
    "compare": ("[OVERRIDES]", "compare results with a blessed baseline or the published numbers"),
    "bless": ("NAME --reason TEXT", "record results as a baseline"),
    "list": ("[methods|datasets|experiments]", "list what can be chosen"),
    "new": ("method|dataset NAME", "write the module, configuration and test of a method or dataset"),
    "data": ("list|get|verify|where", "find and fetch the public datasets"),
    "sync": ("[OVERRIDES]", "write every trial record into the tracker"),
    "ui": ("[OVERRIDES]", "open the MLflow interface on the tracker"),
    "doctor": ("[OVERRIDES]", "check this installation and say how to mend it"),
    "completion": ("bash|zsh|fish", "print a shell's completion script"),
}


def module(verb: str) -> ModuleType:
    """The module of a verb."""
    return import_module(f"nrsfm.harness.cli.{verb}")


def usage() -> str:
    """The help of ``nrsfm`` without a verb."""
    heads = {verb: f"{verb} {words}" for verb, (words, _) in VERBS.items()}
    width = max(map(len, heads.values()))
    lines = [f"  {heads[verb]:{width}}  {text}" for verb, (_, text) in VERBS.items()]
    return "\n".join(["usage: nrsfm VERB ...", "", *lines, EXAMPLES])


EXAMPLES = """
  nrsfm run dataset=dance_yoga method=adaptive
  nrsfm run -m dataset=dance_yoga,face_yoga method=adaptive,edsc noise.level=0,0.02
  nrsfm run experiment=table1 && nrsfm report table1
  nrsfm solve tracks.npz --bodies 2

'nrsfm VERB --help' says more. Exit codes: 0 ok, 1 worse than the baseline, 2 missing or failed, 3 usage,
130 interrupted.
"""
