"""The identity of a trial, computed once before a sweep and carried to whatever runs the trial."""

from __future__ import annotations

from dataclasses import dataclass

from nrsfm.datasets import registry as datasets
from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.harness.config.settings import Settings
from nrsfm.harness.record.trial import Trial
from nrsfm.methods.base import MethodError
from nrsfm.methods.registry import build_method, version


@dataclass(frozen=True)
class Identity:
    """Key of a trial, digest of its data, and the reason why it cannot run.

    Parameters
    ----------
    key : str
        The name of the trial's folder.
    data : str
        Digest of the data; "" where they cannot be read.
    reason : str
        Why the trial cannot run, in one line; "" when it can.
    absent : bool
        Whether the reason is that the data are missing.
    """

    key: str
    data: str = ""
    reason: str = ""
    absent: bool = False


def identify(trial: Trial, settings: Settings) -> Identity:
    """Compute a trial's identity from its configuration, its data and the version of its method."""
    try:
        data = datasets.digest(trial.dataset, settings.data, settings.missing == "stand_in")
        method = build_method({k: v for k, v in trial.method.items() if k != "name"})
    except (DatasetError, MethodError) as error:
        key = trial.key("unavailable", str(error))
        return Identity(key, reason=str(error), absent=isinstance(error, MissingData))
    return Identity(trial.key(data, version(method)), data)
