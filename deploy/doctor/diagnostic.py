"""Diagnostics: results of the checks of the doctor."""

from typing import Literal

import msgspec

Level = Literal["ok", "warning", "problem"]


class Diagnostic(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one check."""

    check: str  # its name, one word
    level: Level = "ok"  # warning: it works, but not as it could
    what: str  # what was found, one sentence
    hint: str = ""  # what to do about it, one sentence; empty if nothing need be done
    about: tuple[str, ...] = ()  # processes that this explains


def ok(check: str, what: str) -> Diagnostic:
    """Make a diagnostic that nothing is wrong."""
    return Diagnostic(check=check, what=what)


def warning(check: str, what: str, hint: str, *about: str) -> Diagnostic:
    """Make a diagnostic of something that limits."""
    return Diagnostic(check=check, level="warning", what=what, hint=hint, about=about)


def problem(check: str, what: str, hint: str, *about: str) -> Diagnostic:
    """Make a diagnostic of something that keeps people from being published."""
    return Diagnostic(check=check, level="problem", what=what, hint=hint, about=about)
