"""What every trial needs, loaded and looked up once by the server from which the trials are forked."""

import scipy.io  # noqa: F401, reads the sequences

from nrsfm.datasets import registry as datasets
from nrsfm.harness.record.environment import environment
from nrsfm.methods import registry as methods

environment()


methods.others()


datasets.others()
