"""What every trial needs, loaded and looked up once by the server from which the trials are forked."""

import harness.worker  # noqa: F401
from datasets import registry as datasets
from harness.environment import environment
from methods import registry as methods

environment()
methods.others()
datasets.others()
