"""What every trial needs, loaded and looked up once by the server from which the trials are forked."""

import harness.worker  # noqa: F401
from harness.environment import environment
from methods.registry import others

environment()
others()
