"""What fuzzing found, as small as it gets: each input once raised what it must not."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Regression:
    """One finding.

    Args:
        name: Target, see `tests.fuzz.targets`.
        story: What happened.
        data: The input.
    """

    name: str
    story: str
    data: bytes


REGRESSIONS: Sequence[Regression] = ()
