"""The error that every verb turns into one line and exit code 3."""


class UsageError(ValueError):
    """A request that cannot be carried out. The message is one line with the remedy."""
