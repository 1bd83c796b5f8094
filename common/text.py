"""Text of messages to users."""

from collections.abc import Sequence

NAMES_MAX = 5  # maximum number of names in a sentence


def listed(names: Sequence[str], most: int = NAMES_MAX, noun: str = "") -> str:
    """Join the first names with commas, and append the number of the other names."""
    more = len(names) - most
    rest = f" and {more} more {noun}".rstrip() if more > 0 else ""
    return f"{', '.join(names[:most])}{rest}"


def named(noun: str, names: Sequence[str]) -> str:
    """Return a noun, in the plural for several names, with the names as by `listed`."""
    return f"{noun}{'s' if len(names) > 1 else ''} {listed(names)}"
