"""Conditions that hold for some time."""

from dataclasses import dataclass


@dataclass(slots=True)
class HeldCondition:
    """A condition that is reported once after it has held for some time.

    Attributes:
        since_ns: Stamp since which it holds [ns]; None if it does not.
        is_reported: True from the report until it no longer holds.
    """

    since_ns: int | None = None
    is_reported: bool = False

    def update(self, holds: bool, stamp_ns: int, lasts_s: float) -> bool:
        """Return True in the first frame in which the condition has held long enough."""
        if not holds:
            self.since_ns, self.is_reported = None, False
            return False
        self.since_ns = stamp_ns if self.since_ns is None else self.since_ns
        if self.is_reported or stamp_ns - self.since_ns < lasts_s * 1e9:
            return False
        self.is_reported = True
        return True
