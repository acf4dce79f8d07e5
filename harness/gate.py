"""The verbs ``compare`` and ``bless``: hold what was measured against a baseline, or make it the baseline."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from harness import parsers
from harness.answers import answers
from harness.baseline import Baseline, bless
from harness.ci import FORMATS, Gate
from harness.compare import compare, tolerances
from harness.comparison import show
from harness.configurations import compose_config
from harness.environment import checkout
from harness.record import Outcome, UsageError
from harness.storage import write_text


def compare_main(argv: Sequence[str]) -> int:
    """Compare; exit code 0 when nothing is worse, 1 when something is, 2 when something is missing or failed.

    Raises
    ------
    UsageError
        If the overrides, the tolerances or the baseline cannot be used.
    """
    given = parsers.compare().read(argv)
    overrides = _with_experiment(given.overrides)
    settings: dict[str, Any] = OmegaConf.to_container(compose_config(_plain(overrides)).compare, resolve=True)  # type: ignore[assignment]
    against, outcomes = str(settings["against"]), measured(overrides)
    paper = compare(None, outcomes, against="published")
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


def bless_main(argv: Sequence[str]) -> int:
    """Record what was measured as a baseline.

    Raises
    ------
    UsageError
        If there is nothing to bless, no reason, or the file cannot be used.
    """
    given = parsers.bless().read(argv)
    path = locate(given.name)
    if checkout() is None and not given.name.endswith(".json"):
        raise UsageError(f"the baselines of an installed harness are not written; name a file, {given.name}.json")
    baseline = bless(
        measured(_with_experiment(given.overrides, Path(given.name).stem)),
        path,
        given.reason,
        f"{datetime.now(UTC):%Y-%m-%d}",
    )
    print(f"{len(baseline.rows)} rows written to {path}")
    return 0


def measured(overrides: Sequence[str]) -> list[Outcome]:
    """Outcomes that the tracker holds for the trials of the overrides."""
    found, _, _ = answers(overrides)
    absent = sum(run is None for _, run in found)
    if absent:
        print(f"{absent} of {len(found)} trials are not run yet; 'harness run' runs them", file=sys.stderr)
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
    return Path(str(resources.files("reports.baselines"))) / f"{name}.json"


def _with_experiment(overrides: Sequence[str], name: str = "quick") -> list[str]:
    named = any(word.lstrip("+").startswith("experiment=") for word in overrides)
    swept = any("," in word or word.startswith(("dataset=", "method=")) for word in overrides)
    return list(overrides) if named or swept else [f"+experiment={name}", *overrides]


def _plain(overrides: Sequence[str]) -> list[str]:
    return [word for word in overrides if word.lstrip("+").startswith(("compare", "experiment="))]
