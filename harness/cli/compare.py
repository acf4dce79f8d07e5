"""The verbs ``compare`` and ``bless``: hold what was measured against a baseline, or make it the baseline."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from nrsfm.harness.cli.parser import Parser
from nrsfm.harness.config.compose import compose_config
from nrsfm.harness.gate.baseline import Baseline
from nrsfm.harness.gate.compare import compare, tolerances
from nrsfm.harness.gate.comparison import show
from nrsfm.harness.gate.formats import FORMATS, Gate
from nrsfm.harness.record.errors import UsageError
from nrsfm.harness.record.folder import write_text
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.tracking.answers import answers
from nrsfm.reports.layouts.baseline import published


def main(argv: Sequence[str]) -> int:
    """Compare; exit code 0 when nothing is worse, 1 when something is, 2 when something is missing or failed.

    Raises
    ------
    UsageError
        If the overrides, the tolerances or the baseline cannot be used.
    """
    given = command_line().read(argv)
    overrides = _with_experiment(given.overrides)
    settings: dict[str, Any] = OmegaConf.to_container(compose_config(_plain(overrides)).compare, resolve=True)  # type: ignore[assignment]
    against, outcomes = str(settings["against"]), measured(overrides)
    paper = compare(published(outcomes), outcomes, against="published")
    if against == "blessed":
        baseline = Baseline.read(locate(str(settings["baseline"])))
        own = compare(baseline, outcomes, tolerances(settings["tolerances"]))
        informs = bool(paper.lines) and not given.strict
        gate = Gate((own, paper) if given.strict else (own,), (paper,) if informs else ())
    elif against == "published":
        gate = Gate((paper,))
    else:
        raise UsageError(f"compare.against is {against!r}, wanted blessed or published")
    for comparison in (*gate.informing, *gate.blocking):
        show(comparison, everything=given.all)
    for name, text_of in FORMATS.items():
        if path := getattr(given, name):
            write_text(path, text_of(gate))
    return gate.code


def measured(overrides: Sequence[str]) -> list[Outcome]:
    """Outcomes that the tracker holds for the trials of the overrides."""
    found, _, _ = answers(overrides)
    absent = sum(run is None for _, run in found)
    if absent:
        print(f"{absent} of {len(found)} trials are not run yet; 'nrsfm run' runs them", file=sys.stderr)
    return [run.outcome for _, run in found if run is not None]


def locate(name: str) -> Path:
    """A baseline's file: a path that ends in .json, or a name among the package's own.

    Raises
    ------
    UsageError
        If the name is neither.
    """
    if name.endswith(".json"):
        return Path(name)
    if not name.replace("_", "").replace("-", "").isalnum():
        raise UsageError(f"baseline {name!r}: wanted a name such as quick, or a path that ends in .json")
    return Path(str(resources.files("nrsfm.reports.baselines"))) / f"{name}.json"


def _with_experiment(overrides: Sequence[str], name: str = "quick") -> list[str]:
    named = any(word.lstrip("+").startswith("experiment=") for word in overrides)
    swept = any("," in word or word.startswith(("dataset=", "method=")) for word in overrides)
    return list(overrides) if named or swept else [f"experiment={name}", *overrides]


def _plain(overrides: Sequence[str]) -> list[str]:
    return [word for word in overrides if word.lstrip("+").startswith(("compare", "experiment="))]


CODES = "exit codes: 0 ok, 1 worse than the baseline, 2 missing or failed, 3 usage"


def command_line() -> Parser:
    parser = Parser(
        "nrsfm compare",
        "Hold measured runs against a blessed baseline, which blocks, and the published numbers, which inform.",
        """\
nrsfm compare experiment=quick
nrsfm compare experiment=table1 compare.baseline=tables
nrsfm compare experiment=table2 compare.baseline=tables --strict
nrsfm compare experiment=table2 compare.against=published
nrsfm compare experiment=quick --markdown gate.md --junit gate.xml  # for a CI's summary and test report""",
        CODES,
    )
    parser.add_overrides(more="; experiment=quick when none is named")
    parser.add_argument("--all", action="store_true", help="show cells that pass, too")
    parser.add_argument("--strict", action="store_true", help="the published numbers block as well, not only inform")
    for name in ("markdown", "junit", "json"):
        parser.add_argument(f"--{name}", type=Path, metavar="FILE", help=f"also write the comparison as {name}")
    return parser
