"""What is wrong with input data, in one line."""


class DatasetError(ValueError):
    """Input data that cannot be used. The message is one line: what, where, and the remedy."""


class MissingData(DatasetError):
    """A file that is not there; the message says how to get it."""
