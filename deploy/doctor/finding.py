"""What the doctor says."""

from typing import Literal

import msgspec

Level = Literal["ok", "warning", "problem"]


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one check."""

    check: str  # its name, one word
    level: Level = "ok"  # warning: it works, but not as it could
    what: str  # what was found, one sentence
    hint: str = ""  # what to do about it, one sentence; empty if nothing need be done
    about: tuple[str, ...] = ()  # processes that this explains


def ok(check: str, what: str) -> Finding:
    """Make a finding that nothing is wrong."""
    return Finding(check=check, what=what)


def warning(check: str, what: str, hint: str, *about: str) -> Finding:
    """Make a finding of something that limits."""
    return Finding(check=check, level="warning", what=what, hint=hint, about=about)


def problem(check: str, what: str, hint: str, *about: str) -> Finding:
    """Make a finding of something that keeps people from being told."""
    return Finding(check=check, level="problem", what=what, hint=hint, about=about)
