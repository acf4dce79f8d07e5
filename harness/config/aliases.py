"""Refuses YAML whose aliases multiply it without end, in configurations that others wrote."""

from __future__ import annotations

import re
from pathlib import Path

import yaml

from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.untrusted import read_bounded

LARGEST = 1 << 20  # bytes of a file
MOST = 100_000  # values of a file when every alias is written out
MARK = re.compile(rb"(?:^|[\s,:\[{-])\*[^\s,\]}]")  # an alias, or a word that looks like one


def check_file(path: Path) -> None:
    """Raise UsageError if a file is too large, or becomes so by its aliases."""
    content = read_bounded(path, LARGEST)
    if not MARK.search(content):
        return
    try:
        document = yaml.compose(content, Loader=yaml.SafeLoader)
        size = _size(document, {}) if document else 0
    except yaml.YAMLError:  # Hydra explains it
        return
    except RecursionError:
        size = MOST + 1
    if size > MOST:
        raise UsageError(f"{path}: its aliases make more than {MOST} values of it; write them out")


def _size(node: yaml.Node, known: dict[yaml.Node, float]) -> float:
    """The number of values below a node when every alias is written out; infinite if it holds itself."""
    if node not in known:
        known[node] = float("inf")  # until it is known
        parts = [part for pair in node.value for part in pair] if isinstance(node, yaml.MappingNode) else node.value
        known[node] = 1 + (0 if isinstance(node, yaml.ScalarNode) else sum(_size(part, known) for part in parts))
    return known[node]
