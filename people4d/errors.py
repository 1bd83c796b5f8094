"""Errors that a user can remedy."""


class People4dError(Exception):
    """A failure in one sentence, with a remedy.

    Args:
        problem: Description of the problem, one sentence without the closing stop.
        hint: Remedy for the user, one sentence; empty if unknown.
    """

    def __init__(self, problem: str, hint: str = "") -> None:
        super().__init__(f"{problem}. {hint}" if hint else problem)
        self.problem = problem
        self.hint = hint


class ConfigError(People4dError):
    """A configuration value is missing, unknown or out of range."""


class DecodeError(People4dError):
    """Bytes from the wire or a file are not the expected message."""


class SourceError(People4dError):
    """An RGB-D source cannot deliver its frames."""


class ModelError(People4dError):
    """A model file is absent, altered or not of the expected form."""


class CalibrationError(People4dError):
    """Observations do not determine the poses of cameras."""
