"""The contract that every method and every dataset keeps, as checks for a test suite.

In a test, for choices of the configuration::

    from nrsfm.harness.testing import Check, parametrize_with_checks

    @parametrize_with_checks("method=my_method", "dataset=my_scenes dataset.points=40")
    def test_contract(check: Check) -> None:
        check()

or all checks at once: ``check_method(MyMethod())``, ``check_dataset(settings)``. A check raises AssertionError with one
line that names the fault. The checks are in :mod:`nrsfm.harness.testing.methods` and
:mod:`nrsfm.harness.testing.datasets`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nrsfm.datasets.errors import MissingData
from nrsfm.harness.config.compose import compose_config
from nrsfm.harness.config.settings import read
from nrsfm.harness.testing import datasets as dataset_contract
from nrsfm.harness.testing import methods as method_contract
from nrsfm.methods.base import Method
from nrsfm.methods.registry import build_method

if TYPE_CHECKING:
    from pytest import MarkDecorator


__all__ = ["Check", "check_dataset", "check_method", "parametrize_with_checks"]
Check = Callable[[], None]


def check_method(method: Method) -> None:
    """Run every check of :mod:`nrsfm.harness.testing.methods`; raises AssertionError at the first that fails."""
    subject = method_contract.Subject(method)
    for check in method_contract.CHECKS:
        check(subject)


def check_dataset(settings: Mapping[str, Any], folder: Path | None = None) -> None:
    """Run every check of :mod:`nrsfm.harness.testing.datasets` on the settings of a ``dataset`` group.

    ``folder`` is the data folder; by default the environment variable ``NRSFM_DATA``, or ``data``. Raises
    AssertionError at the first check that fails, and MissingData if files are missing.
    """
    subject = dataset_contract.Subject(settings, folder or Path(os.environ.get("NRSFM_DATA", "data")))
    for check in dataset_contract.CHECKS:
        check(subject)


def parametrize_with_checks(*choices: str) -> MarkDecorator:
    """Parametrise a pytest test with every check of some choices; the test takes ``check`` and calls it.

    Parameters
    ----------
    *choices : str
        ``method=NAME`` or ``dataset=NAME``, and further overrides after a space. A dataset whose files are missing is
        skipped.

    Raises
    ------
    ValueError
        If a choice starts with neither.
    """
    import pytest

    parameters = []
    for choice in choices:
        group = choice.partition("=")[0]
        if group not in ("method", "dataset"):
            raise ValueError(f"{choice!r} is no choice of a method or dataset, wanted such as method=adaptive")
        checks: Any = method_contract.CHECKS if group == "method" else dataset_contract.CHECKS
        parameters += [pytest.param(_bound(choice, check), id=f"{choice}-{check.__name__}") for check in checks]
    return pytest.mark.parametrize("check", parameters)


def _bound(choice: str, check: Callable[[Any], None]) -> Check:
    def bound() -> None:
        import pytest

        try:
            check(_subject(choice))
        except MissingData as error:
            pytest.skip(str(error))

    return bound


@cache
def _subject(choice: str) -> method_contract.Subject | dataset_contract.Subject:
    """The subject of a choice, made once, so that checks share its results."""
    trial, settings = read(compose_config(choice.split()))
    if choice.startswith("dataset="):
        return dataset_contract.Subject(trial.dataset, settings.data)
    return method_contract.Subject(build_method({k: v for k, v in trial.method.items() if k != "name"}))
