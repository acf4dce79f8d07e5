from __future__ import annotations


class UsageError(ValueError):
    """A request that cannot be carried out as it stands. The message is one line with the remedy."""
