"""Which counters of a heartbeat tell what was lost, or went wrong."""

from collections.abc import Mapping

# Counters of what went well; every other one names a drop or another event by its cause.
PROGRESS = {
    "frames",
    "people",
    "with_position",
    "with_heading",
    "odometry",
    "pictures",
    "predictions",
}
PROGRESS_PREFIXES = ("received_", "sent_", "left_", "taken_over_")  # left: to a replica


def losses(counters: Mapping[str, int]) -> dict[str, int]:
    """Return the counters of losses that there were, sorted by name."""
    return {
        name: count
        for name, count in sorted(counters.items())
        if count and name not in PROGRESS and not name.startswith(PROGRESS_PREFIXES)
    }
