"""Imports and look-ups that every trial needs, done once by the server that forks the trials."""

import scipy.io  # noqa: F401, reads the sequences

from nrsfm.datasets import registry as datasets
from nrsfm.harness.record.environment import environment
from nrsfm.methods import registry as methods

environment()
methods.others()
datasets.others()
