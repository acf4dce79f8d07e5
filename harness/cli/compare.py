"""The verb ``compare``: compare measured results with a baseline and with the published numbers."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from nrsfm.harness.cli.parser import Parser
from nrsfm.harness.record.errors import UsageError

if TYPE_CHECKING:
    from nrsfm.harness.config.spans import Request
    from nrsfm.harness.record.outcome import Outcome


def main(argv: Sequence[str]) -> int:
    """Compare; exit code 0 when nothing is worse, 1 when something is, 2 when something is missing or failed.

    Raises
    ------
    UsageError
        If the overrides, the tolerances or the baseline cannot be used.
    """
    options = command_line().read(argv)
    from nrsfm.harness.config.spans import Request
    from nrsfm.harness.gate.baseline import Baseline
    from nrsfm.harness.gate.comparison import Gate, compare
    from nrsfm.harness.gate.formats import FORMATS, show
    from nrsfm.harness.gate.tolerance import tolerances
    from nrsfm.harness.record.folder import write_text
    from nrsfm.reports.layouts.baseline import published

    request = Request.of(options.overrides, default="quick")
    settings = request.config["compare"]
    against, outcomes = str(settings["against"]), measured(request)
    paper = compare(published(outcomes), outcomes, against="published")
    if against == "blessed":
        baseline = Baseline.read(locate(str(settings["baseline"])))
        own = compare(baseline, outcomes, tolerances(settings["tolerances"]))
        informs = bool(paper.lines) and not options.strict
        gate = Gate((own, paper) if options.strict else (own,), (paper,) if informs else ())
    elif against == "published":
        gate = Gate((paper,))
    else:
        raise UsageError(f"compare.against is {against!r}, wanted blessed or published")
    for comparison in gate.comparisons:
        show(comparison, everything=options.all)
    for name, text_of in FORMATS.items():
        if path := getattr(options, name):
            write_text(path, text_of(gate))
    return gate.code


def measured(request: Request) -> list[Outcome]:
    """The outcomes of the trials of a request."""
    from nrsfm.harness.tracking.trial_runs import answers

    pairs, _ = answers(request)
    absent = sum(run is None for _, run in pairs)
    if absent:
        print(f"{absent} of {len(pairs)} trials are not run yet; 'nrsfm run' runs them", file=sys.stderr)
    return [run.outcome for _, run in pairs if run is not None]


def locate(name: str) -> Path:
    """The file of a baseline: a path that ends in .json, or a name in the package's own folder.

    Raises
    ------
    UsageError
        If the name is neither.
    """
    if name.endswith(".json"):
        return Path(name)
    if not name.replace("_", "").replace("-", "").isalnum():
        raise UsageError(f"baseline {name!r}: wanted a name such as quick, or a path that ends in .json")
    from importlib import resources

    return Path(str(resources.files("nrsfm.reports.baselines"))) / f"{name}.json"


CODES = "exit codes: 0 ok, 1 worse than the baseline, 2 missing or failed, 3 usage"


def command_line() -> Parser:
    parser = Parser(
        "nrsfm compare",
        "Compare measured results with a blessed baseline, which blocks, and with the published numbers, which inform.",
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
