"""Errors that a user can mend."""


class People4dError(Exception):
    """A failure told in one sentence, with what mends it.

    Args:
        problem: What is wrong, one sentence without the closing stop.
        mend: What the user can do about it, one sentence; empty if nothing is known.
    """

    def __init__(self, problem: str, mend: str = "") -> None:
        super().__init__(f"{problem}. {mend}" if mend else problem)
        self.problem = problem
        self.mend = mend


class ConfigError(People4dError):
    """A configuration value is missing, unknown or out of range."""


class DecodeError(People4dError):
    """Bytes from the wire or a file are not the message they should be."""


class SourceError(People4dError):
    """An RGB-D source cannot deliver what was asked of it."""


class ModelError(People4dError):
    """A model file is absent, altered or not of the expected form."""
