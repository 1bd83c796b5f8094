"""Text of messages to people."""

from collections.abc import Sequence

NAMES_MAX = 5  # in a sentence


def listed(names: Sequence[str], most: int = NAMES_MAX, noun: str = "") -> str:
    """Return the first names with commas between, and how many more there are (of a noun)."""
    more = len(names) - most
    rest = f" and {more} more {noun}".rstrip() if more > 0 else ""
    return f"{', '.join(names[:most])}{rest}"


def named(noun: str, names: Sequence[str]) -> str:
    """Return a noun, in the plural if there are several names, and the names as `listed`."""
    return f"{noun}{'s' if len(names) > 1 else ''} {listed(names)}"
