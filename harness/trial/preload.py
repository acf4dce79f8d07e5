"""Imports and look-ups that every trial needs, done once by the server that forks the trials."""

from importlib import import_module

from nrsfm.harness.record.environment import environment
from nrsfm.harness.record.imports import import_late

import_late()
for name in ("nrsfm.harness.trial.worker", "scipy.io", "sklearn.cluster"):  # the last two read and cluster tracks
    import_module(name)
environment()
for package in ("methods", "datasets"):
    import_module(f"nrsfm.{package}.registry").others()
