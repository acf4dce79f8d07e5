"""The verb ``bless``: record measured results as a baseline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from nrsfm.harness.cli.parser import Parser
from nrsfm.harness.record.errors import UsageError


def main(argv: Sequence[str]) -> int:
    """Record what was measured as a baseline.

    Raises
    ------
    UsageError
        If a trial has not run, there is no reason, or the file cannot be used.
    """
    options = command_line().read(argv)
    from datetime import UTC, datetime

    from nrsfm.harness.cli.compare import locate, measured
    from nrsfm.harness.config.spans import Request
    from nrsfm.harness.gate.baseline import bless
    from nrsfm.harness.record.environment import checkout

    path = locate(options.name)
    if checkout() is None and not options.name.endswith(".json"):
        raise UsageError(f"the baselines of the installed package are not written; name a file, {options.name}.json")
    request = Request.of(options.overrides, default=Path(options.name).stem)
    outcomes = measured(request)
    if len(outcomes) < len(request.trials):
        raise UsageError("a baseline holds every trial of its experiment: run the others first, or name fewer")
    baseline = bless(outcomes, path, options.reason, f"{datetime.now(UTC):%Y-%m-%d}")
    print(f"{path}: {len(baseline.rows)} rows of {len(outcomes)} trials")
    return 0


def command_line() -> Parser:
    parser = Parser(
        "nrsfm bless",
        "Record measured runs as a baseline, with the reason why they are right.",
        """\
nrsfm bless quick --reason 'exact E-step' experiment=quick
nrsfm bless tables --reason 'scipy 1.17 finds the eigenvectors to more digits' experiment=tables
nrsfm bless my_lab.json --reason 'first measured' experiment=quick method=adaptive  # a file of your own""",
        "'nrsfm compare experiment=quick compare.baseline=my_lab.json' holds later runs against it.\n\n"
        "exit codes: 0 written, 3 usage: a trial has not run, or there is no reason",
    )
    parser.add_words("name", _baselines, help="one of reports/baselines, or a path that ends in .json")
    parser.add_overrides(more="; experiment=NAME when none is named")
    parser.add_argument("--reason", required=True, help="why these numbers are right; kept in the file")
    return parser


def _baselines() -> Mapping[str, str]:
    from importlib import resources

    names = (file.name for file in resources.files("nrsfm.reports.baselines").iterdir())
    return {name.removesuffix(".json"): "" for name in sorted(names) if name.endswith(".json")}
